//! `mvfusion man`.

use std::fs;
use std::io::{self, Write};

use anyhow::Context;
use clap::{Command, CommandFactory};
use clap_mangen::Man;

use crate::args::ManArgs;
use crate::{Cli, atomic};

/// Writes a manual page for the program and for each command, and prints their paths.
///
/// # Errors
/// If the folder or a page cannot be written, or `out` cannot be written to.
pub fn man(args: &ManArgs, out: &mut dyn Write) -> anyhow::Result<()> {
    fs::create_dir_all(&args.out).with_context(|| format!("cannot make the folder {}", args.out.display()))?;
    let mut program = Cli::command().disable_help_subcommand(true);
    program.build();
    for (name, page) in pages(&program, "mvfusion")? {
        let path = args.out.join(format!("{name}.1"));
        atomic::write(&path, &page)?;
        writeln!(out, "{}", path.display())?;
    }
    Ok(())
}

/// The pages of a command and of the commands within it, by name.
fn pages(command: &Command, name: &str) -> io::Result<Vec<(String, Vec<u8>)>> {
    let mut pages = vec![(name.to_owned(), page(command, name)?)];
    for inner in command.get_subcommands().filter(|inner| !inner.is_hide_set()) {
        pages.extend(self::pages(inner, &format!("{name}-{}", inner.get_name()))?);
    }
    Ok(pages)
}

/// A page. What stands below the options in the help keeps its lines, which `clap_mangen` would fill.
fn page(command: &Command, name: &str) -> io::Result<Vec<u8>> {
    let page = Man::new(command.clone().display_name(name.to_owned()));
    let (mut text, mut extra) = (Vec::new(), Vec::new());
    page.render_title(&mut text)?;
    page.render_name_section(&mut text)?;
    page.render_synopsis_section(&mut text)?;
    page.render_description_section(&mut text)?;
    page.render_options_section(&mut text)?;
    if command.has_subcommands() {
        page.render_subcommands_section(&mut text)?;
    }
    if command.get_after_long_help().is_some() {
        page.render_extra_section(&mut extra)?;
        let (heading, lines) = extra.split_at(extra.iter().position(|&byte| byte == b'\n').map_or(0, |end| end + 1));
        text.extend([heading, b".nf\n", lines, b".fi\n"].concat());
    }
    if command.get_version().is_some() {
        page.render_version_section(&mut text)?;
    }
    Ok(text)
}
