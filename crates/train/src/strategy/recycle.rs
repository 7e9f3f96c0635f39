//! Room in a full cloud: at intervals, the Gaussians that the loss would miss least make place for growth elsewhere. A scene that
//! was merged above its bound comes down to the same room.

use instgs_vk::gpu::{Buffer, GpuError};
use instgs_vk::kernels::{densify_cost, densify_retire};
use instgs_vk::render::scan::ScanInput;
use instgs_vk::render::sort::SortBuffers;

use super::tools::Tools;
use crate::config::TrainConfig;
use crate::device_state::DeviceState;

/// How many expanded Gaussians are to leave a full cloud, and by what they are chosen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Recycling {
    /// Number of expanded Gaussians that may stay.
    pub(super) room: u64,
    /// Steps that the statistics are of.
    pub(super) steps: f32,
}

impl Recycling {
    /// What is due after `done` steps, `None` if nothing is. The statistics are of the steps after `since`, or, without it, of those after
    /// the densification before.
    pub(super) fn due(config: &TrainConfig, done: u64, since: Option<u64>) -> Option<Self> {
        let densify = &config.densify;
        // Densification need not happen at multiples of `recycle_every`: the first one behind each counts.
        let before = Some(done.saturating_sub(densify.every)).filter(|&done| config.densifies_at(done)).unwrap_or(0);
        let since = since.unwrap_or(before);
        let is_due = densify.recycle > 0.0 && done / densify.recycle_every > before / densify.recycle_every;
        // One at least may stay, however small the cap is.
        let room = ((f64::from(config.max_gaussians) * (1.0 - densify.recycle)) as u64).max(1);
        is_due.then_some(Self { room, steps: done.saturating_sub(since) as f32 })
    }

    /// Makes those that cost least count as transparent (`highest_logits`), if the scene has more than may stay. `uses` is the
    /// number of instances and `felt` what the loss feels of them, by source (see `source_use`).
    pub(super) fn retire(
        self,
        tools: &mut Tools,
        state: &DeviceState,
        uses: &Buffer<u32>,
        felt: &Buffer<f32>,
        highest_logits: &mut Buffer<f32>,
    ) -> Result<(), GpuError> {
        let goal = state.layout.expanded_len().saturating_sub(self.room).min(u64::from(u32::MAX)) as u32;
        if goal == 0 {
            return Ok(());
        }
        let count = state.source_count() as u32;
        let mut sort = SortBuffers::new(&tools.gpu, "cost", count as usize)?;
        let mut tables = tools.sort_tables(count)?;
        let mut scratch = tools.scratch(count)?;
        let grid = tools.threads(count);
        let bindings = densify_cost::Bindings {
            felt,
            screen_statistics: &state.gradients.screen_statistics,
            uses,
            keys: &mut sort.keys,
            values: &mut sort.values,
        };
        let params = densify_cost::Params { count, steps: self.steps };
        tools.recorder.dispatch(&tools.pipelines.densify_cost, grid, &params, bindings)?;
        tools.record_sort(&mut scratch, &mut tables, &mut sort)?;
        // In the order of costs; the list of the sort has served.
        let order = ScanInput { values: uses, indices: Some(&sort.values) };
        tools.record_scan(&mut scratch, None, order, &mut sort.keys)?;
        let bindings = densify_retire::Bindings { order: &sort.values, uses_before: &sort.keys, highest_logits };
        let params = densify_retire::Params { count, goal };
        tools.recorder.dispatch(&tools.pipelines.densify_retire, grid, &params, bindings)?;
        // The buffers of the sort must live until it has finished.
        tools.run()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::{ConfigBuilder, ConfigError};

    #[test]
    fn it_is_due_behind_every_multiple() -> Result<(), ConfigError> {
        let config = |sets: &[&str]| {
            sets.iter().try_fold(ConfigBuilder::new(), |builder, set| builder.set(set)).and_then(ConfigBuilder::finish)
        };
        let recycling = config(&["densify.recycle=0.1", "max_gaussians=1000", "densify.recycle_every=250"])?;
        let is_due = |&done: &u64| recycling.densifies_at(done) && Recycling::due(&recycling, done, Some(0)).is_some();
        // Densification begins behind step 500, the first multiple but one.
        assert_eq!((0..=1000).step_by(100).filter(is_due).collect::<Vec<u64>>(), [600, 800, 1000]);
        assert_eq!(Recycling::due(&recycling, 700, Some(600)), None);
        assert_eq!(Recycling::due(&recycling, 800, Some(500)), Some(Recycling { room: 900, steps: 300.0 }));
        // Without the step of a checkpoint: densification begins after 500 steps, and goes on every hundred.
        let early = config(&["densify.recycle=0.1", "densify.start=450", "steps=5000"])?;
        assert_eq!(Recycling::due(&early, 500, None).map(|due| due.steps), Some(500.0));
        assert_eq!(Recycling::due(&recycling, 800, None).map(|due| due.steps), Some(100.0));
        assert_eq!(Recycling::due(&config(&["max_gaussians=1000"])?, 500, Some(0)), None);
        let smallest = config(&["densify.recycle=0.1", "max_gaussians=1"])?;
        assert_eq!(Recycling::due(&smallest, 600, Some(0)).map(|due| due.room), Some(1));
        Ok(())
    }
}
