//! docs/topics.md is written from the topic table, and docs/services.md from that of the services.
//! `GUIDEDOG_WRITE_DOCS=1 cargo test -p guidedog-messages --test documents` writes them.

use std::fmt::Write;
use std::path::Path;

use guidedog_messages::topic::{AgeLimit, TOPICS, TopicSpec};
use guidedog_messages::{SERVICES, ServiceId, ServiceSpec};

const WRITTEN: &str = "<!-- Written by `GUIDEDOG_WRITE_DOCS=1 cargo test -p guidedog-messages --test documents` -->\n";

/// The document is what the table says; it is written where that is asked for.
fn holds(name: &str, text: &str) {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs").join(name);
    if std::env::var_os("GUIDEDOG_WRITE_DOCS").is_some() {
        std::fs::write(&path, text).expect("the document can be written");
    }
    let found = std::fs::read_to_string(&path).unwrap_or_default();
    assert_eq!(
        found, text,
        "docs/{name} is not what the table says: GUIDEDOG_WRITE_DOCS=1 cargo test -p guidedog-messages --test documents"
    );
}

fn list(services: &[ServiceId]) -> String {
    if services.len() == ServiceId::ALL.len() {
        return "every service".to_owned();
    }
    services.iter().map(|service| service.name()).collect::<Vec<_>>().join(", ")
}

fn topic_row(spec: &TopicSpec) -> String {
    let age = match spec.max_age {
        AgeLimit::Unlimited => "-".to_owned(),
        AgeLimit::Configured { key, default_ms, .. } => format!("{default_ms} ms (`max_age.{key}`)"),
        AgeLimit::Decision => "1.5 decision periods".to_owned(),
        AgeLimit::Expiry => "its own end".to_owned(),
        AgeLimit::Beat => "`supervision.beat_limit`".to_owned(),
    };
    format!(
        "| `{}` | {} (`{}`) | {} | {} | {} + {} + {} | {age} | {} | {} |\n",
        spec.name,
        spec.doc.trim().trim_end_matches('.'),
        spec.type_name,
        list(spec.publishers),
        list(spec.subscribers),
        spec.buffer,
        spec.borrowed,
        spec.loans,
        if spec.recorded { "yes" } else { "no" },
        spec.why,
    )
}

#[test]
fn the_topics() {
    let mut text = format!("{WRITTEN}# Topics\n\n");
    text += "The table in `shared/messages/src/topic.rs`. *Depth* is how many messages wait for a reader, how many a \
             reader may hold,\nand how many a writer may be filling. *Age* is how old the newest message may be for \
             motion. The recorder reads what\nis recorded.\n\n";
    text += "| topic | carries | writers | readers | depth | age | recorded | reason for the depth |\n";
    text += "|---|---|---|---|---|---|---|---|\n";
    TOPICS.iter().for_each(|spec| text += &topic_row(spec));
    holds("topics.md", &text);
}

fn service_row(spec: &ServiceSpec) -> String {
    let yes = |is: bool| if is { "yes" } else { "no" };
    let limit = spec.beat_limit_ms.map_or("`beat_limit`".to_owned(), |ms| format!("{ms} ms"));
    let watched_by = spec.watched_by.map_or("-", ServiceId::name);
    let mut row = format!("| `{}` | {} | {} | {watched_by} ", spec.name, spec.stage, yes(spec.critical));
    let _ = write!(row, "| {} | {:?} | {:?} ", yes(spec.restartable), spec.priority, spec.at_supervisor_death);
    let _ = writeln!(row, "| {} ms, {limit} | {:?} | {:?} |", spec.beat_period_ms, spec.memory, spec.clock);
    row
}

#[test]
fn the_services() {
    let mut text = format!("{WRITTEN}# Services\n\n");
    text += "The table in `shared/messages/src/service.rs`, in the order of start. A service starts when everything of \
             lower stages is\nready. *Watched by*: the service that stops the robot when this one's lifeline closes. \
             *Beats*: from one to the next, and\nhow old the last one may be. A run's configuration changes a few of \
             these: depth is critical where\n`depth.needed` says so, a `cue` that listens is `Large`, and a `replay` \
             in place of the world is as the simulator.\n\n";
    text += "| service | stage | critical | watched by | restarted | priority | at the supervisor's death | beats | \
             memory | clock |\n|---|---|---|---|---|---|---|---|---|---|\n";
    SERVICES.iter().for_each(|spec| text += &service_row(spec));
    holds("services.md", &text);
}
