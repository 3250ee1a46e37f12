//! `gaware config`, and the file that `gaware run --config` reads: every long option of `run` is a key with the same meaning, and is
//! checked by the same code. What the command line or the environment gives wins over the file.

use super::run::RunArgs;
use super::{CommandError, output};
use clap::parser::ValueSource;
use clap::{Arg, ArgMatches, Args, Command, FromArgMatches};
use std::collections::BTreeMap;
use std::ffi::OsString;
use std::fmt::Write;
use std::ops::Range;
use std::path::{Path, PathBuf};
use toml::{Spanned, Value};

/// Where the service's file is.
const SERVICE_FILE: &str = "/etc/gaware.toml";
/// Options that make no sense in a file.
const NOT_IN_A_FILE: [&str; 3] = ["config", "json", "help"];
/// Width of comments.
const WIDTH: usize = 96;

/// Arguments of `gaware config`.
#[derive(Debug, Clone, clap::Args)]
pub struct ConfigArgs {
    /// What to do.
    #[command(subcommand)]
    pub action: ConfigAction,
}

/// What to do with a configuration file.
#[derive(Debug, Clone, clap::Subcommand)]
pub enum ConfigAction {
    /// Check a file: unknown keys and wrong values are reported with line and column.
    Check {
        /// File.
        #[arg(default_value = SERVICE_FILE)]
        file: PathBuf,
    },
    /// Print every key with its meaning, its value in the file or its default. Tokens are not printed.
    Show {
        /// File (without one: all defaults).
        file: Option<PathBuf>,
    },
}

/// Why a configuration file cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum ConfigError {
    /// It cannot be read.
    #[error("cannot read {path}: {source}")]
    Read {
        /// File.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// Something in it is wrong.
    #[error("{path}, line {line}, column {column}: {reason}")]
    Wrong {
        /// File.
        path: PathBuf,
        /// Line, from 1.
        line: usize,
        /// Column, from 1.
        column: usize,
        /// What is wrong, and what would be right.
        reason: String,
    },
}

/// A file that is read, every key known and every value valid.
#[derive(Debug)]
pub struct Config {
    path: PathBuf,
    entries: Vec<Entry>,
}

/// One key as arguments of the command line.
#[derive(Debug)]
struct Entry {
    key: String,
    value: Value,
    arguments: Vec<OsString>,
}

/// Runs the command.
///
/// # Errors
/// A file that cannot be read or is wrong.
pub fn run(args: &ConfigArgs) -> Result<(), CommandError> {
    match &args.action {
        ConfigAction::Check { file } => {
            let config = Config::read(file)?;
            output::text(&checked(&config)?)
        }
        ConfigAction::Show { file } => {
            let config = file.as_deref().map(Config::read).transpose()?;
            output::text(&listing(config.as_ref()))
        }
    }
}

/// That a file is right, in a line. What a run would end with at once is an error; what the command line may give as well is named.
fn checked(config: &Config) -> Result<String, CommandError> {
    let (name, n) = (config.path.display(), config.entries.len());
    // The file stands for what else a run needs.
    let args = config.merged(&["--config".into(), config.path.clone().into()]);
    let args = args.map_err(|e| ConfigError::Wrong {
        path: config.path.clone(),
        line: 1,
        column: 1,
        reason: e.to_string().lines().next().unwrap_or_default().to_owned(),
    })?;
    super::start::check(&args)?;
    Ok(if args.connect.is_empty() {
        format!("{name}: {n} options, each valid; a run needs also --connect\n")
    } else {
        format!("{name}: {n} options, all valid\n")
    })
}

/// The options of `run`.
fn options() -> Command {
    let mut command = RunArgs::augment_args(Command::new("gaware run"));
    command.build();
    command
}

fn is_for_files(arg: &Arg) -> bool {
    arg.get_long().is_some_and(|name| !NOT_IN_A_FILE.contains(&name))
}

impl Config {
    /// Reads and checks a file.
    ///
    /// # Errors
    /// A file that cannot be read or is wrong.
    pub fn read(path: &Path) -> Result<Self, ConfigError> {
        let text = crate::inputs::text(path)
            .map_err(|source| ConfigError::Read { path: path.to_owned(), source })?;
        Self::parse(path, &text)
    }

    fn parse(path: &Path, text: &str) -> Result<Self, ConfigError> {
        let wrong = |at: Range<usize>, reason: String| {
            let before = text.get(..at.start).unwrap_or(text);
            let line = before.matches('\n').count() + 1;
            let column = before.rsplit('\n').next().map_or(0, |l| l.chars().count()) + 1;
            ConfigError::Wrong { path: path.to_owned(), line, column, reason }
        };
        let table: BTreeMap<Spanned<String>, Spanned<Value>> = toml::from_str(text)
            .map_err(|e| wrong(e.span().unwrap_or_default(), e.message().trim_end().to_owned()))?;
        let mut in_order: Vec<_> = table.into_iter().collect();
        in_order.sort_by_key(|(key, _)| key.span().start);
        let command = options();
        let mut entries = Vec::new();
        for (key, value) in in_order {
            let arg =
                command.get_arguments().find(|a| a.get_long() == Some(key.get_ref()) && is_for_files(a));
            let arg = arg.ok_or_else(|| wrong(key.span(), unknown(&command, key.get_ref())))?;
            let arguments = arguments(arg, key.get_ref(), value.get_ref())
                .and_then(|arguments| valid(&command, path, &arguments).map(|()| arguments))
                .map_err(|reason| wrong(value.span(), reason))?;
            entries.push(Entry { key: key.into_inner(), value: value.into_inner(), arguments });
        }
        let all: Vec<OsString> = entries.iter().flat_map(|e| e.arguments.clone()).collect();
        valid(&command, path, &all).map_err(|reason| wrong(0..0, reason))?;
        Ok(Self { path: path.to_owned(), entries })
    }

    /// The arguments of a run: those of the command line (after the word `run`), and of the file what the line does not give.
    ///
    /// # Errors
    /// Arguments that do not fit together.
    pub fn merged(&self, line: &[OsString]) -> Result<RunArgs, clap::Error> {
        let command = options();
        let given = command.clone().try_get_matches_from(with_name(line))?;
        let from_file = self.entries.iter().filter(|e| !is_given(&command, &given, &e.key));
        let all: Vec<OsString> =
            from_file.flat_map(|e| e.arguments.iter().cloned()).chain(line.iter().cloned()).collect();
        RunArgs::from_arg_matches(&command.try_get_matches_from(with_name(&all))?)
    }

    /// The file.
    pub fn path(&self) -> &Path {
        &self.path
    }
}

fn with_name(arguments: &[OsString]) -> impl Iterator<Item = OsString> {
    std::iter::once(OsString::from("gaware run")).chain(arguments.iter().cloned())
}

/// Whether the command line or the environment has this option, or one that excludes it.
fn is_given(command: &Command, given: &ArgMatches, key: &str) -> bool {
    let by_user = |arg: &Arg| {
        let source = given.value_source(arg.get_id().as_str());
        matches!(source, Some(ValueSource::CommandLine | ValueSource::EnvVariable))
    };
    let excludes =
        |a: &Arg, b: &Arg| command.get_arg_conflicts_with(a).iter().any(|c| c.get_id() == b.get_id());
    let Some(own) = command.get_arguments().find(|a| a.get_long() == Some(key)) else { return false };
    command.get_arguments().any(|other| {
        by_user(other) && (other.get_id() == own.get_id() || excludes(own, other) || excludes(other, own))
    })
}

/// A key's value as arguments.
fn arguments(arg: &Arg, key: &str, value: &Value) -> Result<Vec<OsString>, String> {
    let several = matches!(arg.get_action(), clap::ArgAction::Append);
    match (arg.get_action().takes_values(), value) {
        (false, Value::Boolean(true)) => Ok(vec![format!("--{key}").into()]),
        (false, Value::Boolean(false)) => Ok(Vec::new()),
        (false, _) => Err(format!("{key} is true or false")),
        (true, Value::Array(items)) if several => {
            items.iter().map(|item| scalar(key, item).map(OsString::from)).collect()
        }
        (true, _) => Ok(vec![scalar(key, value)?.into()]),
    }
}

fn scalar(key: &str, value: &Value) -> Result<String, String> {
    match value {
        Value::String(text) => Ok(format!("--{key}={text}")),
        Value::Integer(number) => Ok(format!("--{key}={number}")),
        Value::Float(number) => Ok(format!("--{key}={number}")),
        _ => Err(format!("{key} is one text or number")),
    }
}

/// Whether the program takes these arguments.
fn valid(command: &Command, path: &Path, arguments: &[OsString]) -> Result<(), String> {
    // The file stands for what else a run needs.
    let file = [OsString::from("--config"), path.into()];
    let all: Vec<OsString> = file.into_iter().chain(arguments.iter().cloned()).collect();
    let result = command.clone().try_get_matches_from(with_name(&all));
    result.map(drop).map_err(|error| {
        let text = error.to_string();
        text.lines().next().unwrap_or_default().trim_start_matches("error: ").to_owned()
    })
}

/// What is wrong with a key, and which one was meant.
fn unknown(command: &Command, key: &str) -> String {
    let known: Vec<&str> =
        command.get_arguments().filter(|a| is_for_files(a)).filter_map(Arg::get_long).collect();
    if let Some(meant) = known.iter().find(|k| **k == key.replace('_', "-")) {
        return format!("unknown key {key}; write {meant}");
    }
    format!("unknown key {key}; known are {}", known.join(", "))
}

/// Every key with its meaning and its value: of the file, otherwise the default as a comment.
pub fn listing(config: Option<&Config>) -> String {
    let mut out = String::from(
        "# Options of `gaware run --config FILE`, as on its command line, which wins over this file.\n\
         # `gaware config check FILE` checks it.\n",
    );
    for arg in options().get_arguments().filter(|a| is_for_files(a)) {
        let Some(key) = arg.get_long() else { continue };
        let help =
            arg.get_long_help().or_else(|| arg.get_help()).map(ToString::to_string).unwrap_or_default();
        let _ = write!(out, "\n{}", comment(&help));
        let entry = config.and_then(|c| c.entries.iter().find(|e| e.key == key));
        let _ = match entry {
            Some(_) if arg.is_hide_env_values_set() => writeln!(out, "#{key} = \"is set, not shown\""),
            Some(entry) => writeln!(out, "{key} = {}", entry.value),
            None => writeln!(out, "#{key} = {}", default(arg)),
        };
    }
    out
}

/// The default of an option as a value, or what may stand there.
fn default(arg: &Arg) -> String {
    if !arg.get_action().takes_values() {
        return "false".to_owned();
    }
    if let Some(value) = arg.get_default_values().first() {
        let text = value.to_string_lossy();
        return if text.parse::<f64>().is_ok() { text.into_owned() } else { format!("\"{text}\"") };
    }
    let name = arg.get_value_names().and_then(|n| n.first()).map_or("…", |n| n.as_str());
    if matches!(arg.get_action(), clap::ArgAction::Append) {
        format!("[\"{name}\"]")
    } else {
        format!("\"{name}\"")
    }
}

/// A text as lines of comment.
fn comment(text: &str) -> String {
    let mut lines = vec![String::from("#")];
    for word in text.split_whitespace() {
        match lines.last_mut() {
            Some(line) if line.chars().count() + word.chars().count() < WIDTH => {
                line.push(' ');
                line.push_str(word);
            }
            _ => lines.push(format!("# {word}")),
        }
    }
    lines.join("\n") + "\n"
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::net::SocketAddr;

    fn parse(text: &str) -> Result<Config, String> {
        Config::parse(Path::new("gaware.toml"), text).map_err(|e| e.to_string())
    }

    fn line(words: &[&str]) -> Vec<OsString> {
        words.iter().map(OsString::from).collect()
    }

    #[test]
    fn errors_have_line_and_column_and_what_would_be_right() {
        let cases = [
            ("rate = 100\nrate_hz = 5\n", "line 2, column 1: unknown key rate_hz; known are connect"),
            ("# a\n\n  no_record = true\n", "line 3, column 3: unknown key no_record; write no-record"),
            (
                "rate = 5000\n",
                "line 1, column 8: invalid value '5000' for '--rate <HZ>': write a whole number of Hz",
            ),
            ("headless = \"yes\"\n", "line 1, column 12: headless is true or false"),
            (
                "connect = [\"serial:/dev/ttyX:1\", \"nonsense\"]\n",
                "line 1, column 11: invalid value 'nonsense'",
            ),
            ("connect = [\n", "gaware.toml, line "),
            ("json = true\n", "unknown key json"),
            ("rate = [1, 2]\n", "line 1, column 8: rate is one text or number"),
            ("record = \"x\"\nno-record = true\n", "cannot be used with"),
        ];
        for (text, said) in cases {
            let error = parse(text).unwrap_err();
            assert!(error.contains(said), "{text}: {error}");
        }
    }

    /// What a run would refuse at once is no valid file.
    #[test]
    fn a_file_is_valid_where_a_run_would_begin() {
        let said = |text: &str| checked(&parse(text).unwrap()).map_err(|e| e.to_string());
        let link = "connect = [\"udpin:127.0.0.1:14550\"]\n";
        let good = said(&format!("{link}airframe = \"small_fixed_wing\"\nfloor = 40\n")).unwrap();
        assert!(good.ends_with("3 options, all valid\n"), "{good}");
        let part = said("rate = 100\n").unwrap();
        assert!(part.contains("each valid; a run needs also --connect"), "{part}");
        for (wrong, why) in [
            ("airframe = \"small_fixed_wing\"\nfloor = 500\nceiling = 10\n", "--floor 500 is not below"),
            ("floor = 50\n", "--airframe"),
            ("airframe = \"nix\"\n", "nix"),
            ("model = \"/nix\"\n", "/nix"),
        ] {
            let error = said(&format!("{link}{wrong}")).unwrap_err();
            assert!(error.contains(why), "{wrong}: {error}");
        }
    }

    #[test]
    fn the_command_line_wins_over_the_file() {
        let file = "connect = [\"udpin:0.0.0.0:14550\", \"tcpout:127.0.0.1:5760\"]\nrate = 50\nheadless = true\nrecord = \"/var/lib/x\"\nweb = \"127.0.0.1:8080\"\n";
        let config = parse(file).unwrap();
        let own = config.merged(&line(&["--config", "gaware.toml"])).unwrap();
        assert_eq!((own.connect.len(), own.rate, own.headless), (2, 50, true));
        assert_eq!(own.web, Some("127.0.0.1:8080".parse::<SocketAddr>().unwrap()));
        let words =
            ["--config", "gaware.toml", "--rate=100", "--connect", "udpin:0.0.0.0:14551", "--no-record"];
        let changed = config.merged(&line(&words)).unwrap();
        assert_eq!(
            (changed.connect.len(), changed.rate, changed.no_record, changed.headless),
            (1, 100, true, true)
        );
    }

    #[test]
    fn the_listing_is_a_valid_file_with_every_option_and_without_the_token() {
        let config = parse("rate = 77\nweb-token = \"do-not-print-this\"\n").unwrap();
        let text = listing(Some(&config));
        assert!(text.contains("\nrate = 77\n") && !text.contains("do-not-print"), "{text}");
        assert_eq!(parse(&text).unwrap().entries.len(), 1);
        assert_eq!(parse(&listing(None)).unwrap().entries.len(), 0);
        for key in ["connect", "record", "telemetry", "airframe", "signing-key", "floor"] {
            assert!(text.contains(&format!("\n#{key} = ")), "{key} in {text}");
        }
    }
}
