//! `Scene.edit`: the engine's edits by name, with their values as keywords. Names, values and units are the command line's.

use glam::DVec3;
use instgs_vk::scene::InstancedScene;
use instgs_vk::scene::edit::{Edit, Keep, MOST_SCATTERED, OffsetSource, Scatter, ScatterOver, Turn, apply};
use instgs_vk::scene::trajectory::Orbit;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::edit_values::{Values, selector};
use crate::error::{raised, warn};
use crate::json::to_python;
use crate::scene::Scene;

/// The operations, as an error lists them.
const OPERATIONS: &str = "duplicate, move, rotate, scale, delete, recolour, swap, scatter, crop and erase";

/// Applies an edit; its remarks are warnings too.
pub(crate) fn edit<'py>(
    py: Python<'py>,
    scene: &Scene,
    operation: &str,
    which: Option<&Bound<'py, PyAny>>,
    values: Option<&Bound<'py, PyDict>>,
) -> PyResult<Bound<'py, PyAny>> {
    let named = |what: &PyErr| raised(format_args!("{operation}: {}", what.value(py)));
    let mut values = Values::new(which, values)?;
    // The snapshot ends here: what is shared when it is changed is copied first.
    let edit = values.edit(&scene.snapshot(py), operation).and_then(|edit| values.end().map(|()| edit));
    let edit = edit.map_err(|e| named(&e))?;
    let outcome = scene.change(py, |scene| apply(scene, &edit)).map_err(raised)?;
    for what in &outcome.warnings {
        warn(py, format_args!("{operation}: {what}"))?;
    }
    to_python(py, &outcome)
}

impl Values<'_, '_> {
    fn edit(&mut self, scene: &InstancedScene, operation: &str) -> PyResult<Edit> {
        Ok(match operation {
            "duplicate" => self.duplicate(scene)?,
            "move" => self.move_to_or_by()?,
            "rotate" => Edit::Rotate { which: self.selector()?, turn: self.turn(scene)? },
            "scale" => Edit::Scale { which: self.selector()?, by: self.needed("by")? },
            "delete" => Edit::Delete { which: self.selector()? },
            "recolour" | "recolor" => {
                let (which, rgb) = (self.selector()?, self.needed_vector::<3>("rgb")?);
                Edit::Recolour { which, rgb: rgb.map(|v| v as f32) }
            }
            "swap" => Edit::Swap { which: self.selector()?, template: self.needed("template")? },
            "scatter" => Edit::Scatter(self.scatter(scene)?),
            "crop" => self.crop()?,
            "erase" => Edit::Erase {
                template: self.needed("template")?,
                centres: self.points("at")?.ok_or_else(|| raised("at=... is missing"))?,
                radius: self.needed("radius")?,
            },
            _ => return Err(raised(format_args!("is no operation: there are {OPERATIONS}"))),
        })
    }

    fn duplicate(&mut self, scene: &InstancedScene) -> PyResult<Edit> {
        let up = self.direction("up")?;
        Ok(Edit::Duplicate {
            which: self.selector()?,
            by: self.vector("by")?.map_or(DVec3::ZERO, DVec3::from_array),
            turn: self.radians("yaw")?.map(|angle| Turn { axis: upwards(scene, up), angle }),
        })
    }

    fn move_to_or_by(&mut self) -> PyResult<Edit> {
        let which = self.selector()?;
        match (self.vector("by")?, self.vector("to")?) {
            (Some(by), None) => Ok(Edit::MoveBy { which, by: DVec3::from_array(by) }),
            (None, Some(to)) => Ok(Edit::MoveTo { which, to: DVec3::from_array(to) }),
            _ => Err(raised("want either by=(dx, dy, dz) or to=(x, y, z)")),
        }
    }

    fn turn(&mut self, scene: &InstancedScene) -> PyResult<Turn> {
        let up = self.direction("up")?;
        match (self.radians("yaw")?, self.vector("axis")?, self.radians("angle")?) {
            (Some(angle), None, None) => Ok(Turn { axis: upwards(scene, up), angle }),
            (None, Some(axis), Some(angle)) => Ok(Turn { axis: DVec3::from_array(axis), angle }),
            _ => Err(raised("want either yaw=degrees, or axis=(x, y, z) and angle=degrees")),
        }
    }

    fn scatter(&mut self, scene: &InstancedScene) -> PyResult<Scatter> {
        let up = self.direction("up")?;
        let up = || upwards(scene, up);
        let (template, count) = (self.needed("template")?, self.needed("count")?);
        if count > MOST_SCATTERED {
            return Err(raised(format_args!("count={count} is too many: at most {MOST_SCATTERED}")));
        }
        let over = match (self.points("path")?, self.points("area")?) {
            (Some(_), Some(_)) => return Err(raised("want either path=... or area=...")),
            (Some(points), None) => ScatterOver::Path { points, up: up(), yaw: self.radians("yaw")?.unwrap_or(0.0) },
            (None, Some(points)) => ScatterOver::Polygon {
                points,
                up: up(),
                min_distance: self.taken("distance")?.unwrap_or(0.0),
                turn: self.radians("turn")?.unwrap_or(std::f64::consts::TAU),
                seed: self.taken("seed")?.unwrap_or(0),
            },
            (None, None) => ScatterOver::Plane {
                point: DVec3::from_array(self.needed_vector("point")?),
                normal: self.vector("normal")?.map_or_else(up, DVec3::from_array),
                extent: self.needed_vector("extent")?,
                min_distance: self.taken("distance")?.unwrap_or(0.0),
                turn: self.radians("turn")?.unwrap_or(std::f64::consts::TAU),
                seed: self.taken("seed")?.unwrap_or(0),
            },
        };
        let offsets = match (self.any("offsets_of"), self.taken("copy")?.unwrap_or(false)) {
            (None, false) => OffsetSource::None,
            (None, true) => {
                return Err(raised("copy=True copies the offsets of an instance: name it with offsets_of=..."));
            }
            (Some(which), false) => OffsetSource::Shared(selector(&which)?),
            (Some(which), true) => OffsetSource::Copied(selector(&which)?),
        };
        Ok(Scatter { template, count, over, offsets })
    }

    fn crop(&mut self) -> PyResult<Edit> {
        let corners = self.needed_matrix::<2, 3>("box")?.map(DVec3::from_array);
        let keep = match self.taken::<String>("keep")?.as_deref() {
            None | Some("inside") => Keep::Inside,
            Some("outside") => Keep::Outside,
            Some(other) => return Err(raised(format_args!("keep=\"{other}\": want \"inside\" or \"outside\""))),
        };
        Ok(Edit::Crop { template: self.needed("template")?, corners, keep })
    }
}

/// The direction that was given, else the scene's own.
fn upwards(scene: &InstancedScene, given: Option<DVec3>) -> DVec3 {
    Orbit::around(scene, given).up
}
