//! Pages with a fault each, which the inspection must notice: a check that cannot fail is none.

use std::sync::OnceLock;

use anyhow::{Context, Result, ensure};

use super::inspection::inspect;
use crate::tiny::train;

/// A fault that is put into a sound report.
#[derive(Clone, Copy)]
pub struct Fault {
    /// Name of the trial.
    pub name: &'static str,
    /// What is replaced, once.
    from: &'static str,
    /// By what.
    to: &'static str,
    /// What the complaint must say.
    complaint: &'static str,
}

/// Where the policy begins: what stands before it is not subject to it.
const POLICY: &str = "<meta http-equiv=\"Content-Security-Policy\"";

/// The faults.
pub const FAULTS: [Fault; 10] = [
    Fault {
        name: "a_broken_picture_is_noticed",
        from: "src=\"data:image/png;base64,iVBOR",
        to: "src=\"data:image/png;base64,AAAA",
        complaint: "were not loaded",
    },
    // Before the policy, which would hide them.
    Fault {
        name: "a_script_that_fails_is_noticed",
        from: POLICY,
        to: "<script>nowhere.to.be.found()</script><meta http-equiv=\"Content-Security-Policy\"",
        complaint: "ReferenceError",
    },
    Fault {
        name: "a_request_is_noticed",
        from: POLICY,
        to: "<link rel=\"stylesheet\" href=\"style.css\"><meta http-equiv=\"Content-Security-Policy\"",
        complaint: "asks for",
    },
    // And after it, so that it must forbid them.
    Fault {
        name: "the_policy_forbids_another_script",
        from: "<body>",
        to: "<body><script>nowhere.to.be.found()</script>",
        complaint: "Content Security Policy",
    },
    Fault {
        name: "the_policy_forbids_a_request",
        from: "<footer>",
        to: "<footer><link rel=\"stylesheet\" href=\"style.css\">",
        complaint: "Content Security Policy",
    },
    Fault {
        name: "a_slider_that_does_not_move_is_noticed",
        from: "clip-path: inset(0 0 0 var(--at))",
        to: "clip-path: inset(0 0 0 50%)",
        complaint: "the edge stands at 50",
    },
    Fault {
        name: "a_slider_that_changes_nothing_is_noticed",
        from: "data-copy=\"v0-composed\" alt=\"cam",
        to: "data-copy=\"v0-gt\" alt=\"cam",
        complaint: "of the pixels",
    },
    Fault {
        name: "a_film_without_pictures_is_noticed",
        from: "data-kind=\"composed\"",
        to: "data-kind=\"none\"",
        complaint: "were not loaded",
    },
    Fault {
        name: "a_film_that_stands_still_is_noticed",
        from: "class=\"play\" type=\"button\"",
        to: "class=\"play\" type=\"button\" disabled",
        complaint: "does not play",
    },
    Fault {
        name: "a_page_too_wide_is_noticed",
        from: "<footer>",
        to: "<footer><div style=\"width: 900px\">x</div>",
        complaint: "pixels wide",
    },
];

impl Fault {
    /// Puts the fault into a report, and demands that it be noticed for the right reason.
    ///
    /// # Errors
    /// If it is not.
    pub fn is_noticed(self) -> Result<()> {
        let sound = sound()?;
        ensure!(sound.contains(self.from), "the report does not contain {}", self.from);
        let folder = tempfile::tempdir()?;
        let page = folder.path().join("faulty.html");
        std::fs::write(&page, sound.replacen(self.from, self.to, 1))?;
        let complaint = inspect(&page, None).err().context("the fault was not noticed")?;
        let complaint = format!("{complaint:#}");
        ensure!(complaint.contains(self.complaint), "another complaint: {complaint}");
        Ok(())
    }
}

/// A sound report, made once for all faults.
fn sound() -> Result<&'static str> {
    static SOUND: OnceLock<Result<String>> = OnceLock::new();
    let make = || -> Result<String> {
        let folder = tempfile::tempdir()?;
        let run = folder.path().join("run");
        train(&run, &[])?;
        Ok(std::fs::read_to_string(run.join("report.html"))?)
    };
    SOUND.get_or_init(make).as_ref().map(String::as_str).map_err(|error| anyhow::anyhow!("no sound report: {error:#}"))
}
