//! The steps of all fields.
//!
//! With sensitivity s, an error e of a value adds about s e^2 to the mean squared error of pictures, and a step d causes
//! d^2 / 12 on average. For a given sum the fewest bits are taken where every value adds the same: d = sqrt(12 D / s). A row
//! has one class for all fields that follow its shape and one for its colour, the mean of what they would like; what a field
//! likes on the whole is in its own step.

use super::entropy::CONTEXTS;
use super::field::{Centre, Classes, Follows, MIDDLE, Memory, Part, Plan, rounded_field};
use super::source::{Field, FieldPart, FixedStep, Table};

/// Halvings of the range in which D is sought: 2^-60 of a range of 200 octaves.
const HALVINGS: usize = 60;
/// At most this many rows of a table are looked at to predict the error.
const LOOKED_AT: usize = 20_000;

/// Positions have at most this many of the steps that they have without sensitivity: half the Gaussian's size.
const MOST_FIXED_STEPS: f64 = 8.0;

/// The steps of a table.
#[derive(Debug)]
pub(super) struct TableSteps {
    pub(super) classes: Classes,
    /// By field.
    pub(super) parts: Vec<Vec<Part>>,
    /// By field, the centres of its columns; empty where values say where they are.
    pub(super) centres: Vec<Vec<f32>>,
}

impl TableSteps {
    /// How field number `f` of the table is coded.
    pub(super) fn of_field<'a>(&'a self, f: usize, field: &Field) -> Plan<'a> {
        let given = Some(&self.centres[f]).filter(|centres| !centres.is_empty());
        let centre = given.map_or(field.centre, |centres| Centre::At(centres));
        Plan { parts: &self.parts[f], classes: &self.classes, centre, opponent: field.opponent }
    }

    /// The same steps with the centres and memories that are best for the values of the table; others get them, too.
    pub(super) fn fixed_for(mut self, table: &Table) -> Self {
        for (f, field) in table.fields.iter().enumerate().filter(|(_, field)| field.can_be_coded) {
            if let Some(rounded) = rounded_field(&field.values, table.rows, &self.of_field(f, field)) {
                (self.parts[f], self.centres[f]) = (rounded.parts, rounded.centres);
            }
        }
        self
    }
}

/// Plans the steps of all tables, by sensitivity for pictures of `picture_psnr_db` beside the unpacked ones, or fixed ones.
pub(super) fn plan(tables: &[Table], picture_psnr_db: Option<f64>) -> Vec<TableSteps> {
    let Some(psnr) = picture_psnr_db else { return tables.iter().map(fixed).collect() };
    let wishes: Vec<Option<Wishes>> = tables.iter().map(|table| is_seen(table).then(|| Wishes::of(table))).collect();
    let most = 10f64.powf(-psnr / 10.0);
    let error = |octaves: f64| {
        let seen = tables.iter().zip(&wishes).filter_map(|(table, wish)| Some((table, wish.as_ref()?)));
        seen.map(|(table, wish)| wish.error(table, octaves)).sum::<f64>()
    };
    // Steps are 2^octaves times those for D = 1.
    let (mut low, mut high) = (-100.0, 100.0);
    for _ in 0..HALVINGS {
        let middle = (low + high) / 2.0;
        if error(middle) > most { high = middle } else { low = middle }
    }
    let steps = |(table, wish): (&Table, Option<Wishes>)| match wish {
        Some(wish) => wish.steps(table, low),
        None => fixed(table),
    };
    tables.iter().zip(wishes).map(steps).collect()
}

/// True if a view shows anything of a table's positions.
fn is_seen(table: &Table) -> bool {
    let mut of_means = table.fields.iter().filter(|field| field.is_position()).flat_map(|field| &field.parts);
    of_means.any(|part| part.sensitivity.iter().any(|&s| s > 0.0))
}

/// The classes of rows whose step is `2^octaves` times that of the middle.
fn class_of(octaves: f64) -> u8 {
    // The cast saturates.
    (octaves + f64::from(MIDDLE)).round().clamp(0.0, (CONTEXTS - 1) as f64) as u8
}

fn median(values: impl Iterator<Item = f64>) -> f64 {
    let mut values: Vec<f64> = values.collect();
    values.sort_unstable_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(0.0)
}

/// Steps without sensitivity: those of positions follow sizes, the others are the same for all rows.
fn fixed(table: &Table) -> TableSteps {
    let octaves: Vec<f64> =
        table.fixed_mean_steps.iter().map(|step| step.max(f64::from(f32::MIN_POSITIVE)).log2()).collect();
    let middle = median(octaves.iter().copied());
    let part = |part: &FieldPart| {
        let (step, follows) = match part.fixed {
            FixedStep::OfSize => (middle.exp2() as f32, Follows::Shape),
            FixedStep::Same(step) => (step, Follows::Nothing),
        };
        Part { columns: part.columns, step, most: part.most, follows, memory: part.memory }
    };
    TableSteps {
        classes: Classes {
            shape: octaves.iter().map(|octaves| class_of(octaves - middle)).collect(),
            colour: vec![MIDDLE; table.rows],
        },
        parts: table.fields.iter().map(|field| field.parts.iter().map(part).collect()).collect(),
        centres: vec![Vec::new(); table.fields.len()],
    }
}

/// What the parts of a table would like for D = 1.
struct Wishes {
    classes: Classes,
    /// By field and part: logarithm of the step of the middle class, to base 2; `None` where it is fixed.
    steps: Vec<Vec<Option<f64>>>,
}

/// Logarithm of the wished step, to base 2.
fn wish(sensitivity: f32, floor: f64) -> f64 {
    0.5 * (12.0 / f64::from(sensitivity).max(floor)).log2()
}

impl Wishes {
    fn of(table: &Table) -> Self {
        let mut sums = [vec![0.0; table.rows], vec![0.0; table.rows]];
        let mut counts = [0.0, 0.0];
        let mut steps = Vec::new();
        for field in &table.fields {
            let mut of_field = Vec::new();
            for part in &field.parts {
                let kind = match part.follows {
                    Follows::Shape => 0,
                    Follows::Colour => 1,
                    Follows::Nothing => {
                        of_field.push(None);
                        continue;
                    }
                };
                // What no view sees counts as a millionth of the usual: its class is the coarsest.
                let seen = part.sensitivity.iter().filter(|&&s| s > 0.0).map(|&s| f64::from(s));
                if seen.clone().next().is_none() {
                    of_field.push(None);
                    continue;
                }
                let floor = 1e-6 * median(seen);
                let wished: Vec<f64> = part.sensitivity.iter().map(|&s| wish(s, floor)).collect();
                let middle = median(wished.iter().copied());
                let weight = part.columns as f64;
                sums[kind].iter_mut().zip(&wished).for_each(|(sum, wish)| *sum += weight * (wish - middle));
                counts[kind] += weight;
                of_field.push(Some(middle));
            }
            steps.push(of_field);
        }
        let [shape, colour] = std::array::from_fn(|kind: usize| {
            sums[kind].iter().map(|sum| class_of(sum / f64::max(counts[kind], 1.0))).collect()
        });
        Self { classes: Classes { shape, colour }, steps }
    }

    fn part(&self, field: usize, index: usize, part: &FieldPart, octaves: f64) -> Part {
        let step = match (self.steps[field][index], part.fixed) {
            (Some(wish), _) => (wish + octaves).exp2() as f32,
            (None, FixedStep::Same(step)) => step,
            // Positions that no view sees, of a table that is planned by others: as exact as can be.
            (None, FixedStep::OfSize) => 0.0,
        };
        Part {
            columns: part.columns,
            step: step.clamp(f32::MIN_POSITIVE, f32::MAX),
            most: part.most,
            follows: part.follows,
            memory: part.memory,
        }
    }

    /// The mean squared error that the steps add to pictures.
    fn error(&self, table: &Table, octaves: f64) -> f64 {
        let every = table.rows.div_ceil(LOOKED_AT).max(1);
        let mut sum = 0.0;
        for (f, field) in table.fields.iter().enumerate().filter(|(_, field)| field.can_be_coded) {
            let width: usize = field.parts.iter().map(|part| part.columns).sum();
            let mut first = 0;
            for (p, part) in field.parts.iter().enumerate() {
                let steps = self.part(f, p, part, octaves).steps();
                let columns = first..first + part.columns;
                first = columns.end;
                let classes = match part.follows {
                    Follows::Nothing => continue,
                    Follows::Shape => &self.classes.shape,
                    Follows::Colour => &self.classes.colour,
                };
                for row in (0..table.rows).step_by(every) {
                    let step = steps[usize::from(classes[row])];
                    let values = columns.clone().map(|c| f64::from(field.values[row * width + c]));
                    let squares: f64 = values.map(|value| square_error(part, value, step)).sum();
                    sum += every as f64 * f64::from(part.sensitivity[row]) * squares;
                }
            }
        }
        sum
    }

    fn steps(mut self, table: &Table, octaves: f64) -> TableSteps {
        // What these views hardly see, others may: nothing moves by more than a part of its size.
        let of_mean = table.fields.iter().enumerate().find(|(_, field)| field.is_position());
        if let Some((f, field)) = of_mean {
            // Also where the class is the finest, but for one in a hundred that are smaller than all others.
            let mut sizes: Vec<f64> = table.fixed_mean_steps.iter().copied().filter(|&step| step > 0.0).collect();
            sizes.sort_unstable_by(f64::total_cmp);
            let small = sizes.get(sizes.len() / 100).copied().unwrap_or(f64::MAX);
            let most = (MOST_FIXED_STEPS * small).log2() + f64::from(MIDDLE);
            self.steps[f][0] = self.steps[f][0].map(|wish| wish.min(most - octaves));
            let steps = self.part(f, 0, &field.parts[0], octaves).steps();
            for (class, fixed) in self.classes.shape.iter_mut().zip(&table.fixed_mean_steps) {
                while *class > 0 && steps[usize::from(*class)] > MOST_FIXED_STEPS * fixed {
                    *class -= 1;
                }
            }
        }
        let parts =
            table.fields.iter().enumerate().map(|(f, field)| {
                field.parts.iter().enumerate().map(|(p, part)| self.part(f, p, part, octaves)).collect()
            });
        TableSteps { parts: parts.collect(), classes: self.classes, centres: vec![Vec::new(); table.fields.len()] }
    }
}

/// Squared error of a value: as rounding leaves it, or on average where what it is rounded from is not known yet.
fn square_error(part: &FieldPart, value: f64, step: f64) -> f64 {
    if part.memory == Memory::Best { step * step / 12.0 } else { (value - (value / step).round() * step).powi(2) }
}
