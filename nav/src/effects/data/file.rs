//! `gaware.effects/1`: effects in a file of a user, and those that a flight showed.

use super::expression::Expression;
use super::{Definition, DefinitionError, Target, define, is_unit};
use crate::effects::Effect;
use serde::{Deserialize, Serialize};

const SCHEMA: &str = "gaware.effects/1";
/// Effects of one file.
const MOST: usize = 64;

#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    schema: String,
    #[serde(default)]
    effect: Vec<Entry>,
}

#[derive(Debug, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Entry {
    name: String,
    /// `gyro` or `accel`.
    target: String,
    /// Of all axes; or of one each.
    #[serde(skip_serializing_if = "Option::is_none")]
    driver: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    x: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    y: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    z: Option<String>,
    /// Checked against that of the drivers.
    #[serde(skip_serializing_if = "Option::is_none")]
    unit: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    prior_sigma: Option<f64>,
    #[serde(default, skip_serializing_if = "String::is_empty")]
    description: String,
    #[serde(default, skip_serializing_if = "String::is_empty")]
    cause: String,
    #[serde(default, skip_serializing_if = "String::is_empty")]
    remedy: String,
}

impl Entry {
    fn definition(&self) -> Result<Definition, DefinitionError> {
        let failed =
            |reason: &str| DefinitionError::Effect { name: self.name.clone(), reason: reason.to_owned() };
        let is_name = |n: &str| {
            (1..=48).contains(&n.len()) && n.bytes().all(|c| matches!(c, b'a'..=b'z' | b'0'..=b'9' | b'_'))
        };
        if let Some(formula) = Definition::of_formula(&self.name) {
            return Ok(formula);
        }
        if !is_name(&self.name) {
            return Err(failed("a name is made of a to z, 0 to 9 and _, at most 48 of them"));
        }
        let target = Target::of_name(&self.target)
            .ok_or_else(|| failed("target must be gyro, accel, position or velocity"))?;
        let axes = [&self.x, &self.y, &self.z];
        if self.driver.is_some() == axes.iter().any(|a| a.is_some()) {
            return Err(failed("give driver for all axes alike, or x, y, z"));
        }
        let parse = |text: &Option<String>| {
            let text = text.as_ref().or(self.driver.as_ref());
            let expression = text.map(|text| Expression::parse(text)).transpose();
            expression.map_err(|source| DefinitionError::Expression { name: self.name.clone(), source })
        };
        let [x, y, z] = axes.map(parse);
        let or = |text: &String, other: &str| if text.is_empty() { other.to_owned() } else { text.clone() };
        Ok(Definition {
            name: self.name.clone(),
            target,
            drivers: [x?, y?, z?],
            prior_sigma: self.prior_sigma,
            description: or(&self.description, "an effect of a user"),
            cause: or(&self.cause, "as the file that defines it says"),
            remedy: or(&self.remedy, "as the file that defines it says"),
        })
    }
}

fn parsed(text: &str) -> Result<File, DefinitionError> {
    let file: File = toml::from_str(text).map_err(|e| DefinitionError::Syntax(e.message().to_owned()))?;
    if file.schema != SCHEMA {
        return Err(DefinitionError::Schema(file.schema));
    }
    if file.effect.len() > MOST {
        return Err(DefinitionError::Syntax(format!("more than {MOST} effects")));
    }
    Ok(file)
}

/// Whether a text is meant as such a file: it names the schema, of whatever version.
pub fn is_one(text: &str) -> bool {
    text.contains("gaware.effects/")
}

/// Whether a file is one, without defining anything.
///
/// # Errors
/// As [`load`], but for units and names that are taken.
pub fn check(text: &str) -> Result<(), DefinitionError> {
    parsed(text)?.effect.iter().try_for_each(|entry| entry.definition().map(|_| ()))
}

/// Reads a file and defines its effects.
///
/// # Errors
/// Not TOML, unknown keys, expressions that are none, units that do not fit, names that are taken.
///
/// # Examples
/// ```
/// let effects = gaware_nav::effects::data::load(
///     "schema = \"gaware.effects/1\"\n[[effect]]\nname = \"esc_coupling\"\ntarget = \"gyro\"\nz = \"current\"\nunit = \"deg/h/A\"\n",
/// )?;
/// assert_eq!(effects[0].name(), "esc_coupling");
/// # Ok::<(), gaware_nav::effects::data::DefinitionError>(())
/// ```
pub fn load(text: &str) -> Result<Vec<&'static dyn Effect>, DefinitionError> {
    let file = parsed(text)?;
    let one = |entry: &Entry| {
        let effect = define(entry.definition()?)?;
        match (&entry.unit, effect.groups().first()) {
            (Some(unit), Some(group)) if !is_unit(unit, group.unit) => Err(DefinitionError::Effect {
                name: entry.name.clone(),
                reason: format!("its drivers give the unit {}, not {unit}", group.unit.symbol),
            }),
            _ => Ok(effect),
        }
    };
    file.effect.iter().map(one).collect()
}

/// The file that defines these effects; those of the catalogue need none.
pub fn written<'a>(definitions: impl IntoIterator<Item = &'a Definition>) -> String {
    let entry = |d: &Definition| {
        let text = |k: usize| d.drivers[k].as_ref().map(|e: &Expression| e.text().to_owned());
        let same = d.drivers.iter().all(|x| *x == d.drivers[0]);
        let own = |k: usize| if same { None } else { text(k) };
        Entry {
            name: d.name.clone(),
            target: d.target.name().to_owned(),
            driver: if same { text(0) } else { None },
            x: own(0),
            y: own(1),
            z: own(2),
            unit: None,
            prior_sigma: d.prior_sigma,
            description: d.description.clone(),
            cause: d.cause.clone(),
            remedy: d.remedy.clone(),
        }
    };
    let file = File { schema: SCHEMA.to_owned(), effect: definitions.into_iter().map(entry).collect() };
    toml::to_string(&file).unwrap_or_default()
}
