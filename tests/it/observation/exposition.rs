//! A strict reader of the text format of OpenMetrics, as far as the manager may use it.
//!
//! Source: <https://prometheus.io/docs/specs/om/open_metrics_spec/>.

use std::collections::BTreeMap;

/// All families by name.
#[derive(Debug, Default)]
pub struct Exposition {
    families: BTreeMap<String, Family>,
}

#[derive(Debug, Default)]
struct Family {
    kind: String,
    unit: String,
    has_help: bool,
    /// By the sample's whole name and labels, as written.
    samples: BTreeMap<String, f64>,
}

impl Exposition {
    /// Reads the whole text; panics at whatever the format does not allow.
    #[track_caller]
    pub fn read(text: &str) -> Self {
        let body = text.strip_suffix("# EOF\n").expect("it ends with # EOF and a line feed");
        let mut exposition = Self::default();
        let mut present = String::new();
        for line in body.lines() {
            if let Some(comment) = line.strip_prefix("# ") {
                let [what, name, text] = words(comment);
                let is_new = name != present && !exposition.families.contains_key(name);
                assert!(is_new || name == present, "{line}: a family is not in one piece");
                name.clone_into(&mut present);
                let family = exposition.families.entry(present.clone()).or_default();
                assert!(family.samples.is_empty(), "{line}: metadata behind samples");
                match what {
                    "TYPE" => text.clone_into(&mut family.kind),
                    "UNIT" => text.clone_into(&mut family.unit),
                    "HELP" => family.has_help = !text.is_empty(),
                    _ => panic!("{line}: unknown metadata"),
                }
                continue;
            }
            let (series, value) = line.rsplit_once(' ').expect("a value behind a blank");
            let name = series.split('{').next().expect("a name");
            let family = exposition.families.get_mut(&present).expect("metadata comes first");
            assert!(family.suffixes().iter().any(|s| name == format!("{present}{s}")), "{line}");
            check_labels(series.strip_prefix(name).expect("its own beginning"));
            let value = value.parse().unwrap_or_else(|error| panic!("{line}: {error}"));
            assert!(family.samples.insert(series.to_owned(), value).is_none(), "{line}: twice");
        }
        exposition.families.iter().for_each(|(name, family)| family.check(name));
        exposition
    }

    /// The value of one series.
    #[track_caller]
    pub fn value(&self, series: &str) -> f64 {
        let mut all = self.families.values().flat_map(|family| &family.samples);
        let found = all.find(|(name, _)| *name == series);
        found.map_or_else(|| panic!("no {series} in {self:?}"), |(_, &value)| value)
    }

    /// The value of one of our own series, which has one label.
    #[track_caller]
    pub fn labelled(&self, name: &str, label: &str, value: &str) -> f64 {
        self.value(&format!("polyptych_{name}{{{label}=\"{value}\"}}"))
    }

    /// Names of all families that only grow, with the sum of their series.
    pub fn growing(&self) -> BTreeMap<String, f64> {
        let growing = self.families.iter().filter(|(_, f)| f.kind == "counter");
        growing.map(|(name, family)| (name.clone(), family.samples.values().sum())).collect()
    }
}

impl Family {
    fn suffixes(&self) -> &'static [&'static str] {
        match self.kind.as_str() {
            "counter" => &["_total"],
            "gauge" => &[""],
            "info" => &["_info"],
            "histogram" => &["_bucket", "_sum", "_count"],
            kind => panic!("unknown type {kind:?}"),
        }
    }

    fn check(&self, name: &str) {
        assert!(self.has_help, "{name} has no help");
        let is_plain = |c: char| c.is_ascii_lowercase() || c == '_';
        assert!(name.chars().all(is_plain), "{name}: a name of other letters");
        let has_unit = self.unit.is_empty() || name.ends_with(&format!("_{}", self.unit));
        assert!(has_unit, "{name} does not end with its unit {}", self.unit);
        let is_counted = matches!(self.kind.as_str(), "counter" | "histogram");
        assert!(!is_counted || self.samples.values().all(|&v| v >= 0.0), "{name} is below 0");
        if self.kind != "histogram" {
            return;
        }
        let bound = |series: &str| {
            let le = series.split("le=\"").nth(1)?.strip_suffix("\"}")?;
            Some(if le == "+Inf" { f64::INFINITY } else { le.parse().expect("a number") })
        };
        let mut buckets: Vec<(f64, f64)> =
            self.samples.iter().filter_map(|(series, &v)| Some((bound(series)?, v))).collect();
        buckets.sort_by(|a, b| a.0.total_cmp(&b.0));
        assert!(buckets.is_sorted_by(|a, b| a.1 <= b.1), "{name}: not cumulative: {buckets:?}");
        let count = self.samples.get(&format!("{name}_count"));
        assert_eq!(buckets.last().map(|&(_, v)| v), count.copied(), "{name}: +Inf is not all");
        assert!(self.samples.contains_key(&format!("{name}_sum")), "{name} has no sum");
    }
}

/// Returns the three parts of a comment: keyword, name, and the rest of the line.
fn words(comment: &str) -> [&str; 3] {
    let mut words = comment.splitn(3, ' ');
    [(); 3].map(|()| words.next().unwrap_or_else(|| panic!("{comment}: not three words")))
}

/// Nothing, or labels in braces, none of which needs an escape here.
fn check_labels(labels: &str) {
    if labels.is_empty() {
        return;
    }
    let inner = labels.strip_prefix('{').and_then(|rest| rest.strip_suffix('}'));
    for label in inner.unwrap_or_else(|| panic!("{labels}")).split(',') {
        let (name, value) = label.split_once('=').unwrap_or_else(|| panic!("{labels}"));
        assert!(name.chars().all(|c| c.is_ascii_lowercase()), "{labels}");
        let value = value.strip_prefix('"').and_then(|rest| rest.strip_suffix('"'));
        assert!(value.is_some_and(|value| !value.contains(['"', '\\'])), "{labels}");
    }
}
