//! Dispatches of a [`Recorder`]: they bind the buffers of a kernel, whole or in parts, after the barriers that these need.

use std::sync::Arc;

use ash::vk;

use super::barrier::Access;
use super::buffer::{Buffer, BufferMemory, BufferPart};
use super::error::GpuError;
use super::interface::{BindingSet as _, Kernel, MOST_BINDINGS};
use super::pipeline::Pipeline;
use super::recorder::Recorder;

/// Number of work-groups of a direct dispatch.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Grid {
    /// Work-groups along x.
    pub x: u32,
    /// Work-groups along y.
    pub y: u32,
}

impl Grid {
    /// `count` work-groups, folded into two dimensions of at most 65535 (the smallest limit that Vulkan allows);
    /// kernels flatten the index again and check it against their count.
    pub fn groups(count: u32) -> Self {
        const ROW: u32 = 65535;
        if count <= ROW { Self { x: count.max(1), y: 1 } } else { Self { x: ROW, y: count.div_ceil(ROW) } }
    }

    /// The fewest work-groups of `size` threads that cover `threads`.
    pub fn threads(threads: u32, size: u32) -> Self {
        Self::groups(threads.div_ceil(size))
    }
}

/// The buffers of a dispatch.
struct Buffers<'a, 'b, K: Kernel> {
    /// By the names that the kernel has for them.
    bindings: &'a K::Bindings<'b>,
    /// What is bound of those of which not all is.
    parts: &'a [BufferPart],
    /// The buffer of the work-group counts, if the host does not know them.
    indirect: Option<&'a Arc<BufferMemory>>,
}

impl Recorder {
    /// Dispatches `grid` work-groups of a kernel.
    ///
    /// # Errors
    /// The grid exceeds the device's limit, a buffer is larger than a binding, or the pipeline or a buffer is of another device.
    pub fn dispatch<K: Kernel>(
        &mut self,
        pipeline: &Pipeline<K>,
        grid: Grid,
        params: &K::Params,
        bindings: K::Bindings<'_>,
    ) -> Result<(), GpuError> {
        self.dispatch_parts(pipeline, grid, params, bindings, &[])
    }

    /// The same as [`Recorder::dispatch`], but of the buffers in `parts` it binds these parts alone.
    ///
    /// # Errors
    /// The same errors as [`Recorder::dispatch`].
    pub fn dispatch_parts<K: Kernel>(
        &mut self,
        pipeline: &Pipeline<K>,
        grid: Grid,
        params: &K::Params,
        bindings: K::Bindings<'_>,
        parts: &[BufferPart],
    ) -> Result<(), GpuError> {
        let most = self.gpu.caps().max_workgroup_count;
        if grid.x > most || grid.y > most {
            let reason = format!("{} by {} work-groups; the device takes {most} along each", grid.x, grid.y);
            return Err(self.refuse(K::SHADER.name, &reason));
        }
        let buffers = Buffers::<K> { bindings: &bindings, parts, indirect: None };
        self.run(pipeline, params, buffers, |device, commands| {
            // SAFETY: the pipeline, its sets and push constants are bound by `run`; the grid is within the device's limits.
            unsafe { device.cmd_dispatch(commands, grid.x, grid.y, 1) };
        })
    }

    /// Dispatches a kernel with the work-group counts in element `index` of `args` (three u32 each).
    ///
    /// # Errors
    /// A buffer is larger than a binding, or the pipeline or a buffer is of another device.
    ///
    /// # Panics
    /// If `args` has no such element.
    pub fn dispatch_indirect<K: Kernel, A: bytemuck::NoUninit>(
        &mut self,
        pipeline: &Pipeline<K>,
        args: &Buffer<A>,
        index: usize,
        params: &K::Params,
        bindings: K::Bindings<'_>,
    ) -> Result<(), GpuError> {
        self.dispatch_indirect_parts(pipeline, args, index, params, bindings, &[])
    }

    /// The same as [`Recorder::dispatch_indirect`], but of the buffers in `parts` it binds these parts alone.
    ///
    /// # Errors
    /// The same errors as [`Recorder::dispatch_indirect`].
    ///
    /// # Panics
    /// If `args` has no such element.
    pub fn dispatch_indirect_parts<K: Kernel, A: bytemuck::NoUninit>(
        &mut self,
        pipeline: &Pipeline<K>,
        args: &Buffer<A>,
        index: usize,
        params: &K::Params,
        bindings: K::Bindings<'_>,
        parts: &[BufferPart],
    ) -> Result<(), GpuError> {
        const { assert!(size_of::<A>() == 12, "indirect arguments are three u32") };
        assert!(index < args.len(), "{}: no indirect arguments {index}", args.name());
        let buffers = Buffers::<K> { bindings: &bindings, parts, indirect: Some(args.inner()) };
        self.run(pipeline, params, buffers, |device, commands| {
            // SAFETY: as in `dispatch`; the offset lies in the buffer, which `run` keeps, and is a multiple of 4.
            unsafe { device.cmd_dispatch_indirect(commands, args.handle(), 12 * index as u64) };
        })
    }

    fn run<K: Kernel>(
        &mut self,
        pipeline: &Pipeline<K>,
        params: &K::Params,
        buffers: Buffers<'_, '_, K>,
        dispatch: impl FnOnce(&ash::Device, vk::CommandBuffer),
    ) -> Result<(), GpuError> {
        let name = K::SHADER.name;
        if !Arc::ptr_eq(&pipeline.gpu, &self.gpu) {
            return Err(self.refuse(name, "the pipeline is of another device"));
        }
        self.begin()?;
        let Buffers { bindings, parts, indirect } = buffers;
        let most_bytes = self.gpu.caps().max_storage_bytes;
        let mut bound = [(0, vk::DescriptorBufferInfo::default()); MOST_BINDINGS];
        let (mut count, mut kept) = (0, Ok(()));
        self.accesses.clear();
        bindings.visit(&mut |b| {
            let handle = b.buffer.handle();
            self.accesses.push((handle, if b.writable { Access::SHADER_WRITE } else { Access::SHADER_READ }));
            let part = parts.iter().find(|part| part.buffer == handle);
            let (offset, range) = part.map_or((0, vk::WHOLE_SIZE), |part| (part.offset, part.bytes));
            bound[count] = (b.binding, vk::DescriptorBufferInfo { buffer: handle, offset, range });
            count += 1;
            if kept.is_ok() {
                kept = self.keep(b.buffer, name);
            }
            let bytes = part.map_or(b.buffer.bytes(), |part| part.bytes);
            if bytes > most_bytes && kept.is_ok() {
                let reason = format!("{bytes} bytes of buffer {}; a binding has at most {most_bytes}", b.buffer.name());
                kept = Err(self.refuse(name, &reason));
            }
        });
        kept?;
        if let Some(args) = indirect {
            self.accesses.push((args.handle(), Access::INDIRECT));
            self.keep(args, name)?;
        }
        self.order();
        let set = self.descriptors.allocate(&self.gpu.device, pipeline.set_layout)?;
        let mut writes = [vk::WriteDescriptorSet::default(); MOST_BINDINGS];
        for (write, (binding, info)) in writes.iter_mut().zip(&bound[..count]) {
            *write = vk::WriteDescriptorSet::default()
                .dst_set(set)
                .dst_binding(*binding)
                .descriptor_type(vk::DescriptorType::STORAGE_BUFFER)
                .buffer_info(std::slice::from_ref(info));
        }
        self.mark(name);
        let (commands, device) = (self.commands, &self.gpu.device);
        let timer = self.profiler.as_mut().and_then(|p| p.begin(commands, name));
        // SAFETY: the set was just allocated with the pipeline's layout, whose bindings these are (contract of `Kernel`); the
        // command buffer is recording; `kept` holds the buffers until the submission is over.
        unsafe {
            device.update_descriptor_sets(&writes[..count], &[]);
            device.cmd_bind_pipeline(commands, vk::PipelineBindPoint::COMPUTE, pipeline.handle);
            device.cmd_bind_descriptor_sets(commands, vk::PipelineBindPoint::COMPUTE, pipeline.layout, 0, &[set], &[]);
            if K::SHADER.push_constant_bytes > 0 {
                let bytes = bytemuck::bytes_of(params);
                device.cmd_push_constants(commands, pipeline.layout, vk::ShaderStageFlags::COMPUTE, 0, bytes);
            }
        }
        dispatch(device, commands);
        if let Some(profiler) = &mut self.profiler {
            profiler.end(commands, timer);
        }
        Ok(())
    }
}
