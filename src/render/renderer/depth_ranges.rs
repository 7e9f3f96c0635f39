//! Frames with more visible chunks than the buffers hold: drawn front to back in as many depth ranges as it takes.
//!
//! A range is a depth layer (`glsl/include/layers.glsl`) whose bounds the host chooses: it counts the range's chunks, which
//! is cheap, and halves the range until they fit. Chunks that reach through several ranges are expanded in each. Tiles that the
//! ranges before have closed hide what is behind, and the picture has the bytes that it would have in one piece.

use crate::gpu::interface::constants::*;
use crate::gpu::staging::download;
use crate::kernels::Purpose;
use crate::scene::Camera;

use super::super::device_scene::DeviceScene;
use super::super::error::RenderError;
use super::super::forward::{
    ForwardInputs, read_counters, record_begin, record_chunks, record_end, record_instances_of_frame, write_counters,
};
use super::super::frame_buffers::FrameBuffers;
use super::super::frame_stats::FrameStats;
use super::super::layers::record_close_tiles;
use super::super::render_options::{RenderOptions, view_of};
use super::growth::Growth;
use super::{Counters, EachSlab, Renderer, Start, unreachable_state};
use crate::gpu::{GpuError, Recorder};

/// The depths from `begin` to below `end`, as bits of f32, which have their order.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct DepthRange {
    begin: u32,
    end: u32,
}

impl DepthRange {
    const ALL: Self = Self { begin: 0, end: f32::INFINITY.to_bits() };

    /// Two ranges that begin about as many chunks each, given the chunks by bin of their nearest depth; `None` if this one has
    /// a single depth.
    fn halves(self, bins: &[u32]) -> Option<[Self; 2]> {
        let Self { begin, end } = self;
        if end - begin < 2 {
            return None;
        }
        let within = (begin / LAYER_BIN_BITS) as usize..(end.div_ceil(LAYER_BIN_BITS) as usize).min(bins.len());
        let total: u64 = bins[within.clone()].iter().map(|&count| u64::from(count)).sum();
        let mut sum = 0;
        let half = within.clone().find(|&bin| {
            sum += u64::from(bins[bin]);
            2 * sum >= total
        });
        // Behind the bin with the middle chunk, or before it, or through it.
        let bounds = half.map(|bin| [bin as u32 + 1, bin as u32].map(|bin| bin.saturating_mul(LAYER_BIN_BITS)));
        let inside = bounds.into_iter().flatten().find(|&bound| begin < bound && bound < end);
        let middle = inside.unwrap_or(begin + (end - begin) / 2);
        Some([Self { begin, end: middle }, Self { begin: middle, end }])
    }
}

impl Renderer {
    /// Draws a frame in depth ranges whose chunks fit the buffers.
    ///
    /// # Errors
    /// The chunks that reach through one depth do not fit.
    pub(super) fn render_in_ranges(
        &mut self,
        scene: &DeviceScene,
        camera: &Camera,
        options: &RenderOptions,
        each: &mut EachSlab<'_>,
    ) -> Result<FrameStats, RenderError> {
        self.capacities.work_items = self.most_work_items_of(options);
        self.beyond_chunks = Some(self.capacities.work_items);
        // As for any frame of depth layers, which this one is from here on.
        let options = &RenderOptions { occlusion: true, ..*options };
        self.prepare(Purpose::Layered, scene, camera, options)?;
        let mut stats = FrameStats { in_ranges: true, ..FrameStats::default() };
        let (mut counters, bins) = self.count_instances(scene, camera, options, &mut stats)?;
        // The buffers are as they stay: less, maybe, than was asked for.
        let most = self.most_work_items_of(options);
        self.capacities.work_items = most;
        let mut left = vec![DepthRange::ALL];
        while let Some(range) = left.pop() {
            // Only the first and the last range of a frame are special.
            let layer = u32::from(stats.layers > 0);
            let is_last = range.end == DepthRange::ALL.end;
            counters[COUNTER_LAYER as usize] = layer;
            counters[COUNTER_LAST_LAYER as usize] = if is_last { layer } else { LAYERS - 1 };
            counters[(COUNTER_LAYER_BEGIN + layer) as usize] = range.begin;
            counters[(COUNTER_LAYER_BEGIN + layer + 1) as usize] = range.end;
            counters[COUNTER_SLAB_BEGIN as usize] = 0;
            counters =
                self.submit_counting(scene, camera, options, counters, &mut stats, |recorder, inputs, frame| {
                    if let Some(layers) = inputs.pipelines.layers.as_ref().filter(|_| layer > 0) {
                        record_close_tiles(recorder, layers, frame)?;
                    }
                    record_chunks(recorder, inputs, frame)
                })?;
            let needed = counters[COUNTER_WORK_ITEMS_NEEDED as usize];
            if needed > most {
                match range.halves(&bins) {
                    Some([front, back]) => left.extend([back, front]),
                    None => return Err(self.too_many_at_one_depth(needed, most, options)),
                }
                continue;
            }
            let view = view_of(camera, options);
            counters = self.submit_slab(scene, view, options, each, counters, Start::Chunks)?;
            stats.passes_ms.extend(self.recorder.passes_ms()?);
            stats.layers += 1;
            counters = self.finish_slabs(scene, view, options, each, counters, &mut stats)?;
        }
        // With some room, so that a moving camera does not change from one way to the other all the time.
        self.beyond_chunks = (stats.work_items > u64::from(most / 2)).then_some(most);
        Ok(stats)
    }

    /// The error of a range of a single depth whose chunks do not fit: memory that ran out, if that is why there is no room.
    fn too_many_at_one_depth(&mut self, needed: u32, most: u32, options: &RenderOptions) -> RenderError {
        self.beyond_chunks = None;
        if options.max_chunks == Some(most) {
            let reason =
                format!("{most} is too few: {needed} visible chunks reach through one depth, and are drawn together");
            return RenderError::Option { option: "max_chunks", reason };
        }
        match self.shortage.take() {
            Some(shortage) if most == self.most_chunks => {
                self.most_chunks = u32::MAX;
                shortage.into()
            }
            _ => {
                RenderError::TooMany { what: "visible chunks at one depth", needed: needed.into(), limit: most.into() }
            }
        }
    }

    /// Finds the visible instances; returns the counters, and the chunks of these instances by bin of their nearest depth.
    fn count_instances(
        &mut self,
        scene: &DeviceScene,
        camera: &Camera,
        options: &RenderOptions,
        stats: &mut FrameStats,
    ) -> Result<(Counters, Vec<u32>), RenderError> {
        loop {
            self.prepare_frame(scene, camera, options)?;
            let mut counters = [0; COUNTER_COUNT as usize];
            counters[COUNTER_INSTANCES as usize] = scene.instance_count;
            counters = self.submit_counting(scene, camera, options, counters, stats, record_instances_of_frame)?;
            scene.changes_submitted();
            let Some(frame) = &self.frame else { unreachable_state() };
            let bins = download(&self.gpu, &frame.layer_bins, LAYER_BINS as usize)?;
            let most = self.most_work_items_of(options);
            if self.grow(scene.chunk_pairs, frame.plan.capacities, &counters, most)? == Growth::Fits {
                return Ok((counters, bins));
            }
            stats.redone += 1;
            stats.passes_ms.clear();
        }
    }

    /// Submits passes that only count, starting from `counters`, and waits; adds their times to `stats`. Returns the counters
    /// after them.
    fn submit_counting(
        &mut self,
        scene: &DeviceScene,
        camera: &Camera,
        options: &RenderOptions,
        counters: Counters,
        stats: &mut FrameStats,
        record: impl FnOnce(&mut Recorder, &ForwardInputs<'_>, &mut FrameBuffers) -> Result<(), GpuError>,
    ) -> Result<Counters, RenderError> {
        let (Some(pipelines), Some(frame)) = (self.pipelines.of(Purpose::Layered), &mut self.frame) else {
            unreachable_state()
        };
        let view = view_of(camera, options);
        let inputs = Self::inputs(pipelines, &self.primitives, &self.gpu, scene, view, options);
        write_counters(&mut frame.counters_start, &counters);
        record_begin(&mut self.recorder, frame)?;
        record(&mut self.recorder, &inputs, frame)?;
        record_end(&mut self.recorder, frame)?;
        let ticket = self.recorder.submit()?;
        self.recorder.wait(ticket)?;
        stats.passes_ms.extend(self.recorder.passes_ms()?);
        Ok(read_counters(frame))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn halves_divide_the_chunks_and_then_the_depths() {
        let mut bins = vec![0; LAYER_BINS as usize];
        bins[1000] = 10;
        bins[1003] = 10;
        bins[1100] = 1;
        let at = |bin: u32| bin * LAYER_BIN_BITS;
        let all = DepthRange::ALL.halves(&bins).unwrap_or([DepthRange { begin: 0, end: 0 }; 2]);
        assert_eq!(
            all,
            [DepthRange { begin: 0, end: at(1004) }, DepthRange { begin: at(1004), end: DepthRange::ALL.end }]
        );
        let front = all[0].halves(&bins).unwrap_or([DepthRange { begin: 0, end: 0 }; 2]);
        assert_eq!(front[0].end, at(1001));
        // One bin with everything: first what is before it, then the depths within.
        let [before, with] = front[0].halves(&bins).unwrap_or([DepthRange { begin: 0, end: 0 }; 2]);
        assert_eq!((before.end, with.end), (at(1000), at(1001)));
        assert_eq!(with.halves(&bins).map(|halves| halves[0].end), Some(at(1000) + LAYER_BIN_BITS / 2));
        // Ends.
        let mut range = DepthRange::ALL;
        for _ in 0..200 {
            let Some([a, b]) = range.halves(&bins) else { break };
            assert!(
                a.begin == range.begin && a.end == b.begin && b.end == range.end && a.begin < a.end && b.begin < b.end
            );
            range = a;
        }
        assert_eq!(range.end - range.begin, 1);
    }
}
