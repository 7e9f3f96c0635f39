//! Derives the barrier between two commands: a pure function of how the commands touch buffers.

use ash::vk;
use ash::vk::Handle as _;

/// How a command touches a buffer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Access {
    /// Pipeline stage of the access.
    pub stage: vk::PipelineStageFlags2,
    /// Kinds of memory access, as Vulkan flags.
    pub access: vk::AccessFlags2,
    /// True if the command may write.
    pub writes: bool,
}

impl Access {
    /// Read by a compute shader.
    pub const SHADER_READ: Self = Self {
        stage: vk::PipelineStageFlags2::COMPUTE_SHADER,
        access: vk::AccessFlags2::SHADER_STORAGE_READ,
        writes: false,
    };
    /// Written, and perhaps read, by a compute shader.
    pub const SHADER_WRITE: Self = Self {
        stage: vk::PipelineStageFlags2::COMPUTE_SHADER,
        access: vk::AccessFlags2::from_raw(
            vk::AccessFlags2::SHADER_STORAGE_READ.as_raw() | vk::AccessFlags2::SHADER_STORAGE_WRITE.as_raw(),
        ),
        writes: true,
    };
    /// Arguments of an indirect dispatch.
    pub const INDIRECT: Self = Self {
        stage: vk::PipelineStageFlags2::DRAW_INDIRECT,
        access: vk::AccessFlags2::INDIRECT_COMMAND_READ,
        writes: false,
    };
    /// Read as the source of a copy.
    pub const COPY_READ: Self =
        Self { stage: vk::PipelineStageFlags2::ALL_TRANSFER, access: vk::AccessFlags2::TRANSFER_READ, writes: false };
    /// Written as the destination of a copy or fill.
    pub const COPY_WRITE: Self =
        Self { stage: vk::PipelineStageFlags2::ALL_TRANSFER, access: vk::AccessFlags2::TRANSFER_WRITE, writes: true };
}

/// A memory barrier: source and destination scopes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Barrier {
    /// Pipeline stages to wait for.
    pub src_stage: vk::PipelineStageFlags2,
    /// Writes to make available.
    pub src_access: vk::AccessFlags2,
    /// Pipeline stages that wait.
    pub dst_stage: vk::PipelineStageFlags2,
    /// Accesses that see the writes.
    pub dst_access: vk::AccessFlags2,
}

/// All accesses to buffers since the last barrier.
#[derive(Default)]
pub struct HazardTracker {
    since_barrier: Vec<(u64, Access)>,
}

impl HazardTracker {
    /// Records that the next command makes `accesses`. Returns the barrier that must precede it, which it needs if it
    /// touches a buffer that was written, or writes one that was read.
    pub fn next(&mut self, accesses: &[(vk::Buffer, Access)]) -> Option<Barrier> {
        let conflict = |(buffer, access): &(vk::Buffer, Access)| {
            let raw = buffer.as_raw();
            self.since_barrier.iter().any(|(known, past)| *known == raw && (past.writes || access.writes))
        };
        let barrier = accesses.iter().any(conflict).then(|| self.flush(accesses));
        for &(buffer, access) in accesses {
            let raw = buffer.as_raw();
            if !self.since_barrier.contains(&(raw, access)) {
                self.since_barrier.push((raw, access));
            }
        }
        barrier
    }

    /// A global barrier from all pending accesses to the coming command; clears the pending list.
    fn flush(&mut self, coming: &[(vk::Buffer, Access)]) -> Barrier {
        let mut barrier = Barrier::default();
        for (_, past) in self.since_barrier.drain(..) {
            barrier.src_stage |= past.stage;
            if past.writes {
                barrier.src_access |= past.access;
            }
        }
        for (_, access) in coming {
            barrier.dst_stage |= access.stage;
            barrier.dst_access |= access.access;
        }
        // The pending list is now empty: this barrier must cover every access that later commands can make.
        barrier.dst_stage |= vk::PipelineStageFlags2::COMPUTE_SHADER
            | vk::PipelineStageFlags2::DRAW_INDIRECT
            | vk::PipelineStageFlags2::ALL_TRANSFER;
        barrier.dst_access |= Access::SHADER_WRITE.access
            | Access::INDIRECT.access
            | Access::COPY_READ.access
            | Access::COPY_WRITE.access;
        barrier
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn buffer(n: u64) -> vk::Buffer {
        vk::Buffer::from_raw(n)
    }

    #[test]
    fn reads_need_no_barrier_and_writes_do() {
        let mut tracker = HazardTracker::default();
        assert_eq!(tracker.next(&[(buffer(1), Access::SHADER_READ)]), None);
        assert_eq!(tracker.next(&[(buffer(1), Access::SHADER_READ), (buffer(2), Access::SHADER_WRITE)]), None);
        let barrier = tracker.next(&[(buffer(2), Access::INDIRECT)]).expect("read after write");
        assert!(barrier.src_access.contains(vk::AccessFlags2::SHADER_STORAGE_WRITE));
        assert!(barrier.dst_access.contains(vk::AccessFlags2::INDIRECT_COMMAND_READ));
        assert_eq!(tracker.next(&[(buffer(1), Access::SHADER_WRITE)]), None, "the barrier covered the old read");
        assert!(tracker.next(&[(buffer(2), Access::SHADER_WRITE)]).is_some(), "write after read");
        assert!(tracker.next(&[(buffer(2), Access::COPY_WRITE)]).is_some(), "write after write");
    }
}
