//! The operations of `instgs-vk edit`: repeatable flags, kept in the order of the command line.

use std::str::FromStr;

use clap::{Arg, ArgAction, ArgMatches, Args, Command, FromArgMatches};
use glam::DVec3;

use instgs_vk::scene::edit::{
    AlignTo, Edit, Extra, Keep, MOST_SCATTERED, OffsetSource, ParseSelectorError, Scatter, ScatterOver, Selector, Turn,
};

/// Growth of the box of `--give`, relative to its size.
const GIVE_MARGIN: f64 = 0.05;

/// One operation: its flag and the words after the flag.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Operation {
    flag: &'static str,
    words: Vec<String>,
}

/// All operations, in the order given.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct Operations(Vec<Operation>);

/// For each flag: its name, the names of its values, its help text.
const FLAGS: [(&str, &[&str], &str); 19] = [
    (
        "duplicate",
        &["K", "by=DX,DY,DZ", "yaw=DEG"],
        "Copy an instance, shifted and rotated about the up axis; the two share offsets and own Gaussians until one is recoloured",
    ),
    ("move", &["K", "by=DX,DY,DZ|to=X,Y,Z"], "Move an instance by a vector, or its centre to a position"),
    (
        "rotate",
        &["K", "yaw=DEG|axis=X,Y,Z", "angle=DEG"],
        "Rotate an instance about its centre: about the up axis, or about an axis",
    ),
    ("scale", &["K", "by=S"], "Scale an instance about its centre"),
    ("delete", &["K"], "Remove an instance, and its offsets and own Gaussians unless others share them"),
    (
        "recolour",
        &["K", "rgb=R,G,B"],
        "Shift the base colour (1 = from black to white); a whole group changes in its template",
    ),
    ("swap", &["K", "template=G"], "Give an instance another template; its offsets and own Gaussians are dropped"),
    (
        "scatter",
        &["template=G", "count=N", "..."],
        "Add instances: over a plane with point=X,Y,Z extent=W,H [normal=X,Y,Z] [distance=D] [turn=DEG] [seed=S], in a \
         polygon with area=X,Y,Z/X,Y,Z/X,Y,Z/... [distance=D] [turn=DEG] [seed=S], or along path=X,Y,Z/X,Y,Z/... [yaw=DEG]; offsets=shared:K or offsets=copied:K gives them those of K [default: none]",
    ),
    (
        "crop",
        &["template=G", "box=X,Y,Z/X,Y,Z", "keep=inside|outside"],
        "Keep the Gaussians of a template, for all of its instances, that are inside a box of its frame [default] or \
         outside of it; a side may be inf or -inf",
    ),
    (
        "erase",
        &["template=G", "at=X,Y,Z/...", "radius=R"],
        "Remove the Gaussians of a template within a radius of points of its frame",
    ),
    (
        "align",
        &["K", "axis=x|y|z|up|X,Y,Z", "to=lowest|mean|highest|base"],
        "Move instances along an axis until their centres [default: at their mean] or their lower ends (base) are level",
    ),
    (
        "distribute",
        &["K", "axis=x|y|z|up|X,Y,Z"],
        "Move instances along an axis until their centres are at equal distances; the outermost two stay",
    ),
    (
        "mirror",
        &["K", "axis=x|y|z|up|X,Y,Z", "at=X,Y,Z"],
        "Mirror instances across the plane with that normal, through a point [default: the middle of them]; their templates \
         get mirrored twins",
    ),
    ("unique", &["K"], "Make an instance a template of its own, with its offsets, colours and own Gaussians built in"),
    (
        "reset",
        &["K", "what=all|offsets|own|colours"],
        "Remove what sets an instance apart from its template [default: all]",
    ),
    (
        "give",
        &["K", "margin=PART"],
        "Give an instance the Gaussians of the background inside its template's box as its own; the box grows by a part of \
         its size [default: 0.05]",
    ),
    ("take", &["K"], "Return the own Gaussians of an instance to the background, where they are now"),
    ("relight", &["K"], "Give an instance the mean colour matrix of the nearest other instances of its template"),
    ("rename", &["template=G", "name=NAME"], "Name the group of a template"),
];

impl Args for Operations {
    fn augment_args(command: Command) -> Command {
        FLAGS.iter().fold(command, |command, (flag, values, help)| {
            let arg = Arg::new(*flag)
                .long(*flag)
                .action(ArgAction::Append)
                .num_args(1..)
                .value_names(values.iter().copied())
                .help(*help)
                .help_heading("Operations, done in the order given");
            command.arg(if *flag == "recolour" { arg.alias("recolor") } else { arg })
        })
    }

    fn augment_args_for_update(command: Command) -> Command {
        Self::augment_args(command)
    }
}

impl FromArgMatches for Operations {
    fn from_arg_matches(matches: &ArgMatches) -> Result<Self, clap::Error> {
        let mut placed = Vec::new();
        for (flag, _, _) in FLAGS {
            let mut indices = matches.indices_of(flag).into_iter().flatten();
            for words in matches.get_occurrences::<String>(flag).into_iter().flatten() {
                let words: Vec<String> = words.cloned().collect();
                // An occurrence has the position of its first word; its other words follow.
                let at = indices.by_ref().take(words.len()).fold(None, |first, index| first.or(Some(index)));
                placed.push((at, Operation { flag, words }));
            }
        }
        placed.sort_by_key(|(at, _)| *at);
        Ok(Self(placed.into_iter().map(|(_, operation)| operation).collect()))
    }

    fn update_from_arg_matches(&mut self, matches: &ArgMatches) -> Result<(), clap::Error> {
        *self = Self::from_arg_matches(matches)?;
        Ok(())
    }
}

impl Operations {
    pub(super) fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// Parses the edits; `up` is the axis of yaws, and the normal of planes without one.
    pub(super) fn edits(&self, up: DVec3) -> Result<Vec<Edit>, String> {
        let edit = |operation: &Operation| {
            let mut words = Words::new(&operation.words)?;
            let edit = words.edit(operation.flag, up)?;
            words.end().map(|()| edit)
        };
        let named = |operation| edit(operation).map_err(|what| format!("--{}: {what}", operation.flag));
        self.0.iter().map(named).collect()
    }
}

/// The words of one operation that have not been used yet.
struct Words<'a> {
    /// Words that contain no `=`.
    plain: Vec<&'a str>,
    named: Vec<(&'a str, &'a str)>,
}

impl<'a> Words<'a> {
    fn new(words: &'a [String]) -> Result<Self, String> {
        let mut out = Self { plain: Vec::new(), named: Vec::new() };
        for word in words {
            // The name of a group may contain a "=".
            match word.split_once('=').filter(|(name, _)| !name.contains(':')) {
                Some((name, _)) if out.named.iter().any(|(other, _)| *other == name) => {
                    return Err(format!("{name} is given twice"));
                }
                Some(pair) => out.named.push(pair),
                None => out.plain.push(word),
            }
        }
        Ok(out)
    }

    fn edit(&mut self, flag: &str, up: DVec3) -> Result<Edit, String> {
        match flag {
            "scatter" => return self.scatter(up).map(Edit::Scatter),
            "crop" => return self.crop(),
            "rename" => {
                let template = self.needed("template", whole)?;
                return Ok(Edit::Rename { template, name: self.needed("name", |name| Ok(name.to_owned()))? });
            }
            "erase" => {
                let (template, centres) = (self.needed("template", whole)?, self.needed("at", path)?);
                return Ok(Edit::Erase { template, centres, radius: self.needed("radius", number)? });
            }
            _ => {}
        }
        let which = self.selector()?;
        Ok(match flag {
            "duplicate" => Edit::Duplicate {
                which,
                by: self.parsed("by", vector)?.unwrap_or(DVec3::ZERO),
                turn: self.parsed("yaw", radians)?.map(|angle| Turn { axis: up, angle }),
            },
            "move" => match (self.parsed("by", vector)?, self.parsed("to", vector)?) {
                (Some(by), None) => Edit::MoveBy { which, by },
                (None, Some(to)) => Edit::MoveTo { which, to },
                _ => return Err("want either by=DX,DY,DZ or to=X,Y,Z".into()),
            },
            "rotate" => Edit::Rotate { which, turn: self.turn(up)? },
            "scale" => Edit::Scale { which, by: self.needed("by", number)? },
            "delete" => Edit::Delete { which },
            "align" => {
                let axis = self.needed("axis", |text| axis(text, up))?;
                Edit::Align { which, axis, to: self.parsed("to", aligned_to)?.unwrap_or_default() }
            }
            "distribute" => Edit::Distribute { which, axis: self.needed("axis", |text| axis(text, up))? },
            "mirror" => {
                let normal = self.needed("axis", |text| axis(text, up))?;
                Edit::Mirror { which, normal, point: self.parsed("at", vector)? }
            }
            "unique" => Edit::MakeUnique { which },
            "reset" => Edit::Reset { which, what: self.parsed("what", extra)?.unwrap_or_default() },
            "give" => Edit::Give { which, margin: self.parsed("margin", number)?.unwrap_or(GIVE_MARGIN) },
            "take" => Edit::Take { which },
            "relight" => Edit::Relight { which },
            "recolour" => {
                let rgb = self.needed("rgb", vector)?;
                Edit::Recolour { which, rgb: rgb.as_vec3().to_array() }
            }
            _ => Edit::Swap { which, template: self.needed("template", whole)? },
        })
    }

    fn turn(&mut self, up: DVec3) -> Result<Turn, String> {
        match (self.parsed("yaw", radians)?, self.parsed("axis", vector)?, self.parsed("angle", radians)?) {
            (Some(angle), None, None) => Ok(Turn { axis: up, angle }),
            (None, Some(axis), Some(angle)) => Ok(Turn { axis, angle }),
            _ => Err("want either yaw=DEG, or axis=X,Y,Z and angle=DEG".into()),
        }
    }

    fn scatter(&mut self, up: DVec3) -> Result<Scatter, String> {
        let template = self.needed("template", whole)?;
        let count: usize = self.needed("count", whole)?;
        if count > MOST_SCATTERED {
            return Err(format!("count={count} is too many: at most {MOST_SCATTERED}"));
        }
        let over = match (self.parsed("path", path)?, self.parsed("area", path)?) {
            (Some(_), Some(_)) => return Err("want either path=... or area=...".into()),
            (Some(points), None) => ScatterOver::Path { points, up, yaw: self.parsed("yaw", radians)?.unwrap_or(0.0) },
            (None, Some(points)) => ScatterOver::Polygon {
                points,
                up,
                min_distance: self.parsed("distance", number)?.unwrap_or(0.0),
                turn: self.parsed("turn", radians)?.unwrap_or(std::f64::consts::TAU),
                seed: self.parsed("seed", whole)?.unwrap_or(0),
            },
            (None, None) => ScatterOver::Plane {
                point: self.needed("point", vector)?,
                normal: self.parsed("normal", vector)?.unwrap_or(up),
                extent: self.needed("extent", numbers)?,
                min_distance: self.parsed("distance", number)?.unwrap_or(0.0),
                turn: self.parsed("turn", radians)?.unwrap_or(std::f64::consts::TAU),
                seed: self.parsed("seed", whole)?.unwrap_or(0),
            },
        };
        let offsets = self.parsed("offsets", offset_source)?.unwrap_or(OffsetSource::None);
        Ok(Scatter { template, count, over, offsets })
    }

    fn crop(&mut self) -> Result<Edit, String> {
        let template = self.needed("template", whole)?;
        let corners = self.needed("box", corners)?;
        Ok(Edit::Crop { template, corners, keep: self.parsed("keep", kept_side)?.unwrap_or_default() })
    }

    fn selector(&mut self) -> Result<Selector, String> {
        if self.plain.is_empty() {
            return Err("want an instance first: an index, id:N, group:NAME or template:N".into());
        }
        selector(self.plain.remove(0))
    }

    /// Takes the value of a name and parses it; `None` if the name is not there.
    fn parsed<T>(&mut self, name: &str, parse: impl Fn(&str) -> Result<T, String>) -> Result<Option<T>, String> {
        let Some(at) = self.named.iter().position(|(other, _)| *other == name) else { return Ok(None) };
        let (_, value) = self.named.remove(at);
        parse(value).map(Some).map_err(|what| format!("{name}={value}: {what}"))
    }

    fn needed<T>(&mut self, name: &str, parse: impl Fn(&str) -> Result<T, String>) -> Result<T, String> {
        self.parsed(name, parse)?.ok_or_else(|| format!("{name}=... is missing"))
    }

    /// Returns an error if a word was not used.
    fn end(&self) -> Result<(), String> {
        match (self.plain.first(), self.named.first()) {
            (Some(word), _) => Err(format!("unexpected word \"{word}\" (the scene comes before the operations)")),
            (None, Some((name, _))) => Err(format!("has no {name}")),
            (None, None) => Ok(()),
        }
    }
}

fn number(text: &str) -> Result<f64, String> {
    text.trim().parse().ok().filter(|v: &f64| v.is_finite()).ok_or_else(|| "want a number".into())
}

fn radians(text: &str) -> Result<f64, String> {
    number(text).map(f64::to_radians)
}

fn whole<T: FromStr>(text: &str) -> Result<T, String> {
    text.parse().map_err(|_| "want a whole number from 0 on".into())
}

fn numbers<const N: usize>(text: &str) -> Result<[f64; N], String> {
    let values: Option<Vec<f64>> = text.split(',').map(|part| number(part).ok()).collect();
    values.and_then(|v| v.try_into().ok()).ok_or_else(|| format!("want {N} numbers separated by commas"))
}

fn vector(text: &str) -> Result<DVec3, String> {
    numbers(text).map(DVec3::from_array)
}

fn path(text: &str) -> Result<Vec<DVec3>, String> {
    text.split('/').map(vector).collect()
}

/// Parses two corners of a box; sides may be infinite.
fn corners(text: &str) -> Result<[DVec3; 2], String> {
    let corner = |text: &str| -> Option<DVec3> {
        let values: Option<Vec<f64>> = text.split(',').map(|part| part.trim().parse().ok()).collect();
        let corner = <[f64; 3]>::try_from(values?).ok().map(DVec3::from_array)?;
        (!corner.is_nan()).then_some(corner)
    };
    let both = text.split_once('/').and_then(|(low, high)| Some([corner(low)?, corner(high)?]));
    both.ok_or_else(|| "want the lower and the upper corner, X,Y,Z/X,Y,Z".into())
}

/// An axis by name, or as a vector.
fn axis(text: &str, up: DVec3) -> Result<DVec3, String> {
    Ok(match text {
        "x" => DVec3::X,
        "y" => DVec3::Y,
        "z" => DVec3::Z,
        "up" => up,
        _ => vector(text).map_err(|_| "want x, y, z, up or three numbers separated by commas")?,
    })
}

fn aligned_to(text: &str) -> Result<AlignTo, String> {
    Ok(match text {
        "lowest" => AlignTo::Lowest,
        "mean" => AlignTo::Mean,
        "highest" => AlignTo::Highest,
        "base" => AlignTo::Base,
        _ => return Err("want lowest, mean, highest or base".into()),
    })
}

fn extra(text: &str) -> Result<Extra, String> {
    Ok(match text {
        "all" => Extra::All,
        "offsets" => Extra::Offsets,
        "own" => Extra::Own,
        "colours" | "colors" => Extra::Colours,
        _ => return Err("want all, offsets, own or colours".into()),
    })
}

fn kept_side(text: &str) -> Result<Keep, String> {
    match text {
        "inside" => Ok(Keep::Inside),
        "outside" => Ok(Keep::Outside),
        _ => Err("want inside or outside".into()),
    }
}

fn selector(text: &str) -> Result<Selector, String> {
    text.parse().map_err(|e: ParseSelectorError| e.to_string())
}

fn offset_source(text: &str) -> Result<OffsetSource, String> {
    match text.split_once(':') {
        Some(("shared", which)) => selector(which).map(OffsetSource::Shared),
        Some(("copied", which)) => selector(which).map(OffsetSource::Copied),
        _ if text == "none" => Ok(OffsetSource::None),
        _ => Err("want none, shared:K or copied:K".into()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn edits(words: &[&str]) -> Result<Vec<Edit>, String> {
        let command = Operations::augment_args(Command::new("edit"));
        let matches = command.try_get_matches_from([&["edit"], words].concat()).map_err(|e| e.to_string())?;
        Operations::from_arg_matches(&matches).map_err(|e| e.to_string())?.edits(DVec3::NEG_Y)
    }

    #[test]
    fn operations_keep_the_order_of_the_command_line() {
        let line = "--move 3 by=-1,0,2 --delete id:7 --move group:a=b to=1,2,3 --scale 0 by=2 --delete 1 --rotate 2 yaw=180 \
                    --recolor 4 rgb=0.1,0,-0.2 --duplicate 5 --swap 6 template=1";
        let words: Vec<&str> = line.split_whitespace().collect();
        let which = |text: &str| text.parse().unwrap();
        let want = [
            Edit::MoveBy { which: which("3"), by: DVec3::new(-1.0, 0.0, 2.0) },
            Edit::Delete { which: which("id:7") },
            Edit::MoveTo { which: which("group:a=b"), to: DVec3::new(1.0, 2.0, 3.0) },
            Edit::Scale { which: which("0"), by: 2.0 },
            Edit::Delete { which: which("1") },
            Edit::Rotate { which: which("2"), turn: Turn { axis: DVec3::NEG_Y, angle: std::f64::consts::PI } },
            Edit::Recolour { which: which("4"), rgb: [0.1, 0.0, -0.2] },
            Edit::Duplicate { which: which("5"), by: DVec3::ZERO, turn: None },
            Edit::Swap { which: which("6"), template: 1 },
        ];
        assert_eq!(edits(&words).unwrap(), want);
        let plane =
            edits(&["--scatter", "template=1", "count=5", "point=0,1,2", "extent=4,5", "offsets=copied:id:3"]).unwrap();
        let over = ScatterOver::Plane {
            point: DVec3::new(0.0, 1.0, 2.0),
            normal: DVec3::NEG_Y,
            extent: [4.0, 5.0],
            min_distance: 0.0,
            turn: std::f64::consts::TAU,
            seed: 0,
        };
        let offsets = OffsetSource::Copied(Selector::Id(3));
        assert_eq!(plane, [Edit::Scatter(Scatter { template: 1, count: 5, over, offsets })]);
        let line = "--crop template=1 keep=inside box=-1,-inf,0/1,2,inf --erase template=0 at=1,2,3/4,5,6 radius=0.5 \
                    --crop template=0 box=0,0,0/1,1,1 keep=outside";
        let open = [DVec3::new(-1.0, f64::NEG_INFINITY, 0.0), DVec3::new(1.0, 2.0, f64::INFINITY)];
        let centres = vec![DVec3::new(1.0, 2.0, 3.0), DVec3::new(4.0, 5.0, 6.0)];
        let want = [
            Edit::Crop { template: 1, corners: open, keep: Keep::Inside },
            Edit::Erase { template: 0, centres, radius: 0.5 },
            Edit::Crop { template: 0, corners: [DVec3::ZERO, DVec3::ONE], keep: Keep::Outside },
        ];
        assert_eq!(edits(&line.split_whitespace().collect::<Vec<_>>()).unwrap(), want);
        let turned = ["--scatter", "template=1", "count=5", "point=0,1,2", "extent=4,5", "turn=90"];
        let Edit::Scatter(Scatter { over: ScatterOver::Plane { turn, .. }, .. }) = edits(&turned).unwrap().remove(0)
        else {
            panic!("over a plane")
        };
        assert_eq!(turn, std::f64::consts::FRAC_PI_2);
        let path = edits(&["--scatter", "template=0", "count=2", "path=0,0,0/1,0,0", "yaw=90"]).unwrap();
        assert!(
            matches!(&path[0], Edit::Scatter(Scatter { over: ScatterOver::Path { points, .. }, .. }) if points.len() == 2)
        );
    }

    #[test]
    fn operations_of_arranging_and_of_templates() {
        let line = "--align 0,1 axis=up to=base --align group:a axis=0,1,1 --distribute 0,1,2 axis=x --mirror 3 axis=y at=1,2,3 \
                    --unique 3 --reset 2 --reset 2 what=own --give 3 margin=-0.1 --take 3 --relight id:4 \
                    --rename template=1 name=chair --scatter template=0 count=3 area=0,0,0/1,0,0/0,0,1 distance=2 turn=0";
        let which = |text: &str| text.parse().unwrap();
        let points = vec![DVec3::ZERO, DVec3::X, DVec3::Z];
        let over = ScatterOver::Polygon { points, up: DVec3::NEG_Y, min_distance: 2.0, turn: 0.0, seed: 0 };
        let want = [
            Edit::Align { which: which("0,1"), axis: DVec3::NEG_Y, to: AlignTo::Base },
            Edit::Align { which: which("group:a"), axis: DVec3::new(0.0, 1.0, 1.0), to: AlignTo::Mean },
            Edit::Distribute { which: which("0,1,2"), axis: DVec3::X },
            Edit::Mirror { which: which("3"), normal: DVec3::Y, point: Some(DVec3::new(1.0, 2.0, 3.0)) },
            Edit::MakeUnique { which: which("3") },
            Edit::Reset { which: which("2"), what: Extra::All },
            Edit::Reset { which: which("2"), what: Extra::Own },
            Edit::Give { which: which("3"), margin: -0.1 },
            Edit::Take { which: which("3") },
            Edit::Relight { which: which("id:4") },
            Edit::Rename { template: 1, name: "chair".into() },
            Edit::Scatter(Scatter { template: 0, count: 3, over, offsets: OffsetSource::None }),
        ];
        assert_eq!(edits(&line.split_whitespace().collect::<Vec<_>>()).unwrap(), want);
    }

    #[test]
    fn errors_name_the_operation_and_the_word() {
        for (line, want) in [
            ("--move 3", "--move: want either by"),
            ("--move 3 by=1,2", "--move: by=1,2: want 3 numbers"),
            ("--move 3 by=1,nan,2", "want 3 numbers"),
            ("--move by=1,2,3", "--move: want an instance first"),
            ("--move 3 by=1,2,3 to=1,2,3", "want either by"),
            ("--move 3 by=1,2,3 by=1,2,3", "by is given twice"),
            ("--move 3 up=1", "want either by"),
            ("--delete 3 scene.instgs", "unexpected word \"scene.instgs\""),
            ("--delete 3 by=1", "--delete: has no by"),
            ("--delete chair", "names no instance"),
            ("--scale 3", "by=... is missing"),
            ("--rotate 3 axis=0,1,0", "want either yaw=DEG, or axis"),
            ("--recolour 3 rgb=red", "want 3 numbers"),
            ("--swap 3 template=-1", "want a whole number"),
            ("--crop template=0", "box=... is missing"),
            ("--crop template=0 box=0,0,0", "want the lower and the upper corner"),
            ("--crop template=0 box=0,nan,0/1,1,1", "want the lower and the upper corner"),
            ("--crop template=0 box=0,0,0/1,1,1 keep=both", "want inside or outside"),
            ("--crop 0 box=0,0,0/1,1,1", "template=... is missing"),
            ("--erase template=0 at=1,2,3", "radius=... is missing"),
            ("--erase template=0 at=1,2 radius=1", "want 3 numbers"),
            ("--scatter template=0 count=9999999 point=0,0,0 extent=1,1", "too many"),
            ("--scatter template=0 count=9 extent=1,1", "point=... is missing"),
            ("--scatter template=0 count=9 path=1,2,3/4", "want 3 numbers"),
            ("--scatter template=0 count=9 point=0,0,0 extent=1,1 offsets=3", "want none, shared:K"),
            ("--scatter template=0 count=9 path=0,0,0/1,1,1 extent=1,1", "has no extent"),
            ("--scatter template=0 count=9 path=0,0,0/1,1,1 area=0,0,0/1,1,1", "want either path"),
            ("--align 0,1", "axis=... is missing"),
            ("--mirror 0 axis=w", "want x, y, z, up or"),
            ("--align 0,1 axis=x to=left", "want lowest, mean"),
            ("--reset 0 what=shape", "want all, offsets"),
            ("--rename template=0", "name=... is missing"),
        ] {
            let error = edits(&line.split_whitespace().collect::<Vec<_>>()).unwrap_err();
            assert!(error.contains(want), "{line}: {error}");
        }
        assert!(edits(&["--move"]).is_err());
    }
}
