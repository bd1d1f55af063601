//! What the page of a trained run must do.

use std::path::PathBuf;

use anyhow::{Context, Result, ensure};
use mvfusion_cli::viewer::requests::MOST_PAGES;
use mvfusion_tests::ViewerClient;
use serde_json::json;

use super::page::{Page, WINDOW, difference};
use super::{Server, run};
use crate::tiny::{mvfusion, text};

/// A picture that differs in fewer pixels than this is the same one.
const SAME: f64 = 0.002;

fn opened() -> Result<(Server, Page)> {
    let server = Server::start()?;
    let page = Page::open(&server.address())?;
    Ok((server, page))
}

/// The page shows a picture, and everything went well.
pub fn loads() -> Result<()> {
    let (server, mut page) = opened()?;
    let picture = page.picture()?;
    let (least, most) = (picture.iter().min().context("pixels")?, picture.iter().max().context("pixels")?);
    ensure!(most - least > 60, "the picture is flat: {least} to {most}");
    for part in ["Static Gaussians", "Splats", "Step"] {
        let numbers = page.ask("document.getElementById('numbers').textContent")?;
        ensure!(numbers.as_str().is_some_and(|text| text.contains(part)), "{part} is missing: {numbers}");
    }
    // Overlays and every control of the picture, too.
    for (id, value) in [("frusta", "true"), ("points", "true"), ("background", "1"), ("up", "+y"), ("largest", "480")] {
        page.set(id, value)?;
        page.picture()?;
    }
    page.reports_nothing(&server.address())?;
    server.end()
}

/// Orbit, zoom and flight, by mouse, keys and touch, change the picture, and a reset brings the first one back.
pub fn moves() -> Result<()> {
    let (_server, mut page) = opened()?;
    let first = page.picture()?;
    let mut before = first.clone();
    let mut changed = |page: &mut Page, what: &str| -> Result<()> {
        let now = page.picture()?;
        let share = difference(&before, &now);
        ensure!(share > 0.02, "{what} changes {share} of the picture");
        before = now;
        Ok(())
    };
    page.drag([120.0, 30.0])?;
    changed(&mut page, "a drag")?;
    page.wheel(-400.0)?;
    changed(&mut page, "the wheel")?;
    // Letters fly after a slider was moved, too.
    page.ask("document.getElementById('time').focus()")?;
    page.hold("KeyD", 400)?;
    changed(&mut page, "a key of flight")?;
    page.touch(&[[[0.0, 0.0], [90.0, 20.0]]])?;
    changed(&mut page, "a finger")?;
    let distance = |page: &mut Page| page.ask("viewer.state.pose.distance")?.as_f64().context("a distance");
    let far = distance(&mut page)?;
    page.touch(&[[[-60.0, 0.0], [-120.0, 10.0]], [[60.0, 0.0], [120.0, 10.0]]])?;
    changed(&mut page, "a pinch")?;
    let near = distance(&mut page)?;
    ensure!(near < 0.7 * far, "fingers twice as far apart change the distance from {far} to {near}");
    page.click("reset")?;
    let again = page.picture()?;
    ensure!(difference(&first, &again) < SAME, "the first view is not restored by a reset");
    Ok(())
}

/// Another time is another picture, but not of the static branch.
pub fn time() -> Result<()> {
    let (_server, mut page) = opened()?;
    let mut at = |layer: &str, time: f64| -> Result<Vec<u8>> {
        page.set("layer", layer)?;
        page.set("time", &time.to_string())?;
        page.picture()
    };
    let share = difference(&at("composed", 0.05)?, &at("composed", 0.8)?);
    ensure!(share > 0.002 && share < 0.7, "the time changes {share} of the picture");
    let share = difference(&at("static", 0.05)?, &at("static", 0.8)?);
    ensure!(share == 0.0, "the time changes {share} of the static branch");
    // Played, it goes on by itself.
    page.set("layer", "composed")?;
    let before = page.ask("viewer.state.time")?.as_f64().context("a time")?;
    page.click("play")?;
    page.wait(&format!("viewer.state.time !== {before} && Number(document.body.dataset.frames) > 8"))?;
    page.click("play")?;
    page.picture().map(drop)
}

/// Each layer that can be chosen differs from all others.
pub fn layers() -> Result<()> {
    let (_server, mut page) = opened()?;
    let names = page.ask("[...document.getElementById('layer').options].filter(o => !o.disabled).map(o => o.value)")?;
    let names: Vec<String> = serde_json::from_value(names)?;
    // In the middle, where something moves.
    page.set("time", "0.5")?;
    ensure!(names.len() == 12, "the layers are {names:?}");
    let mut seen: Vec<(String, Vec<u8>)> = Vec::new();
    for name in names {
        page.set("layer", &name)?;
        let picture = page.picture()?;
        for (other, before) in &seen {
            ensure!(*before != picture, "{name} looks like {other}");
        }
        let has_legend = page.ask("!document.getElementById('legend').hidden")?;
        let needs_legend = name == "depth" || name == "motion" || name.ends_with("_variance");
        ensure!(has_legend == needs_legend, "the legend of {name}: {has_legend}");
        seen.push((name, picture));
    }
    Ok(())
}

/// At a held-out camera, the photo is on the left of the line and the render on the right.
pub fn split() -> Result<()> {
    let (_server, mut page) = opened()?;
    page.set("views", "test/2")?;
    page.picture()?;
    let psnr = page.ask("viewer.facts.psnr")?.as_f64().context("a PSNR")?;
    ensure!(psnr > 5.0 && psnr < 60.0, "the PSNR is {psnr}");
    let place = [0.3, 0.5];
    let render = page.canvas_at(place)?;
    ensure!(page.ask("viewer.picture.photo === undefined")? == true, "the photo is loaded before it is shown");
    page.set("compare", "true")?;
    page.wait("viewer.picture.photo?.complete && viewer.picture.photo.naturalWidth > 0")?;
    page.set("split", "1")?;
    page.picture()?;
    let photo = page.canvas_at(place)?;
    let photo_itself = page.ask(
        "(() => {
            const { photo } = viewer.picture;
            const canvas = new OffscreenCanvas(photo.naturalWidth, photo.naturalHeight);
            const context = canvas.getContext('2d');
            context.drawImage(photo, 0, 0);
            const shown = viewer.picture.place(viewer.aspect);
            const { width, height } = viewer.picture.canvas;
            const at = [(0.3 * width - shown.x) / shown.width, (0.5 * height - shown.y) / shown.height];
            const pixel = [Math.floor(at[0] * canvas.width), Math.floor(at[1] * canvas.height)];
            return [...context.getImageData(...pixel, 1, 1).data].slice(0, 3);
        })()",
    )?;
    let photo_itself: [u8; 3] = serde_json::from_value(photo_itself)?;
    let far = |a: [u8; 3], b: [u8; 3]| a.iter().zip(b).map(|(&a, b)| a.abs_diff(b)).max().unwrap_or(0);
    ensure!(far(photo, photo_itself) < 40, "the split shows {photo:?}, and the photo has {photo_itself:?}");
    page.set("split", "0")?;
    let again = page.canvas_at(place)?;
    ensure!(far(render, again) < 8, "without the photo it is {again:?}, and was {render:?}");
    // The line can be dragged.
    page.set("split", "0.5")?;
    page.drag([60.0, 0.0])?;
    page.wait("viewer.state.split > 0.52 && viewer.state.view?.index === 2")?;
    // At another time, there is no PSNR, and the photo says its time.
    page.set("time", "0.11")?;
    page.picture()?;
    let psnr = page.ask("[viewer.facts.psnr ?? null, viewer.picture.caption]")?;
    ensure!(psnr[0].is_null() && psnr[1].as_str().is_some_and(|text| text.starts_with("photo at ")), "{psnr}");
    // A drag elsewhere leaves the photo's camera.
    page.set("split", "0")?;
    page.drag([60.0, 0.0])?;
    page.picture()?;
    ensure!(page.ask("viewer.state.view === undefined")? == true, "the view is left");
    Ok(())
}

/// What is in the address comes back, in a page that never saw it.
pub fn address() -> Result<()> {
    let (server, mut page) = opened()?;
    page.drag([90.0, -20.0])?;
    page.set("time", "0.4")?;
    page.set("layer", "dynamic")?;
    page.set("background", "1")?;
    for (id, value) in [("pace", "2"), ("loop", "false"), ("speed", "1")] {
        page.set(id, value)?;
    }
    let picture = page.picture()?;
    page.wait("['layer=dynamic', 't=0.4', 'fly=1'].every(part => location.hash.includes(part))")?;
    let shared = page.ask("location.href")?.as_str().context("an address")?.to_owned();
    drop(page);
    let mut other = Page::open(&shared)?;
    let again = other.picture()?;
    ensure!(difference(&picture, &again) < SAME, "the view is another one");
    ensure!(other.ask("document.getElementById('layer').value")? == "dynamic", "the layer is not restored");
    let speeds = other.ask("[viewer.state.pace, viewer.state.loop, viewer.state.speed]")?;
    ensure!(speeds == json!([2, false, 1]), "the speeds are {speeds}");
    // A pose keeps its roll, also if the up direction comes with it.
    other.ask("location.hash = 'p=0,0,-3&f=0,0,1&d=1,0,0&r=3&up=-y&t=0.4'")?;
    other.wait("viewer.state.up === '-y' && Math.abs(viewer.state.pose.down[0] - 1) < 1e-6")?;
    // A broken address is not an error.
    other.go(&format!("{}#p=1,2&layer=gt&t=7&view=test/9999&fov=x", server.address()))?;
    other.ask("location.reload()")?;
    other.wait("document.body?.dataset.link === 'open' && Number(document.body.dataset.frames) > 0")?;
    other.picture()?;
    other.reports_nothing(&server.address())
}

/// Two pages see their own views.
pub fn two_pages() -> Result<()> {
    let (server, mut first) = opened()?;
    let mut second = Page::open(&server.address())?;
    first.set("layer", "static")?;
    second.set("layer", "mask")?;
    second.drag([50.0, 10.0])?;
    let (a, b) = (first.picture()?, second.picture()?);
    ensure!(difference(&a, &b) > 0.1, "both pages show the same");
    first.reports_nothing(&server.address())?;
    second.reports_nothing(&server.address())?;
    // A page for which there is no place says so, and comes in when there is one.
    second.ask("viewer.link.connect = () => {}, viewer.link.socket.close()")?;
    second.wait("document.body.dataset.link === 'closed'")?;
    let others = (1..MOST_PAGES).map(|_| ViewerClient::open(server.port)).collect::<Result<Vec<_>>>()?;
    second.ask("delete viewer.link.connect, viewer.link.connect()")?;
    second.wait("document.getElementById('notice').textContent.startsWith('Too many pages')")?;
    drop(others);
    second.wait("document.body.dataset.link === 'open' && document.getElementById('notice').hidden")
}

/// The page says that the server is gone, and goes on when it is back.
pub fn restart() -> Result<()> {
    let (server, mut page) = opened()?;
    let before = page.picture()?;
    let port = server.port;
    server.end()?;
    page.wait("document.body.dataset.link === 'closed' && !document.getElementById('notice').hidden")?;
    let _again = Server::of(&run()?, port)?;
    page.wait("document.body.dataset.link === 'open' && document.getElementById('notice').hidden")?;
    page.drag([80.0, 0.0])?;
    let after = page.picture()?;
    ensure!(difference(&before, &after) > 0.02, "the page does not go on");
    Ok(())
}

/// A path of two keys is what `mvfusion render` accepts, with its times.
pub fn path() -> Result<()> {
    let (_server, mut page) = opened()?;
    page.set("time", "0.25")?;
    page.click("add-key")?;
    page.drag([100.0, 20.0])?;
    page.set("time", "0.75")?;
    page.click("add-key")?;
    page.set("seconds", "0.2")?;
    // The file as it is offered.
    let saved = page.ask(
        "(async () => {
            let file;
            const make = URL.createObjectURL;
            URL.createObjectURL = blob => { file = blob; return make.call(URL, blob); };
            document.getElementById('save-path').click();
            URL.createObjectURL = make;
            return file.text();
        })()",
    )?;
    // It can be opened again, and what is no path is refused with a sentence.
    let opened = page.ask(&format!(
        "(async () => {{
            const {{ fromFile }} = await import(new URL('path.js', location.href));
            const refused = [null, [], {{}}, {{ camera_path: [] }}, {{ camera_path: [{{}}] }}];
            const saved = {};
            for (const [key, value] of [['fov', '60'], ['fov', 175], ['render_time', 2], ['camera_to_world', [1]]]) {{
                const entry = {{ ...saved.camera_path[0], [key]: value }};
                refused.push({{ camera_path: [entry] }});
            }}
            const words = refused.map(file => {{
                try {{ return fromFile(file) && 'opened'; }} catch (error) {{ return error.message; }}
            }});
            return [fromFile(saved).keys.length, words];
        }})()",
        saved.as_str().context("a file")?
    ))?;
    let (keys, words): (usize, Vec<String>) = serde_json::from_value(opened)?;
    let is_told = |words: &String| words.contains("must") || words.contains("lists no cameras");
    ensure!(keys == 2 && words.iter().all(is_told), "{keys} keys, and {words:?}");
    let folder = tempfile::tempdir()?;
    let path = folder.path().join("fly.json");
    std::fs::write(&path, saved.as_str().context("a file")?)?;
    let read = mvfusion_data::camera_path::read_camera_path(&path)?;
    let times: Vec<f64> = read.entries.iter().filter_map(|entry| entry.time).collect();
    ensure!(times.len() == 7 && times.is_sorted(), "the times are {times:?}");
    ensure!((times[0] - 0.25).abs() < 1e-3 && (times[6] - 0.75).abs() < 1e-3, "the times are {times:?}");
    let out = folder.path().join("film");
    let said = mvfusion(&[
        "render",
        text(&run()?)?,
        "--views",
        text(&path)?,
        "--layers",
        "composed",
        "--format",
        "png",
        "--size",
        "64x48",
        "--out",
        text(&out)?,
        "--device",
        "cpu",
    ])?;
    ensure!(said.contains("7 at 64x48"), "{said}");
    Ok(())
}

/// Nothing stands out of the window, in both colours; the pictures stay in the folder of the build's temporary files.
pub fn looks() -> Result<()> {
    let (server, mut page) = opened()?;
    for (name, size) in [("desktop", WINDOW), ("phone", [390, 780])] {
        page.resize(size)?;
        for (colours, is_dark) in [("light", false), ("dark", true)] {
            let features = json!([{"name": "prefers-color-scheme", "value": colours}]);
            page.connection().call("Emulation.setEmulatedMedia", json!({"features": features}))?;
            page.ask("scrollTo(0, 0)")?;
            page.picture()?;
            let file = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join(format!("viewer-{name}-{colours}.png"));
            let shown = page.screenshot(&file)?;
            let level = shown.get_pixel(shown.width() - 3, shown.height() - 3).0[0];
            ensure!((level < 64) == is_dark, "{name}, {colours}: the panel has the level {level}");
            let width = page.ask("document.documentElement.scrollWidth")?.as_u64().context("a width")?;
            ensure!(width <= u64::from(size[0]), "{name}: the page is {width} pixels wide");
        }
    }
    page.reports_nothing(&server.address())
}
