//! The plan, as the command says it.

use super::fail::Failure;
use super::load::Loaded;
use super::progress::Progress;
use super::report::Report;
use halflight::engine::{Engine, Medium};
use halflight::error::bytes;
use halflight::plan::{self, Made, Plan, Request};
use halflight::scene::Scene;
use serde_json::json;

/// The bar's stage.
pub const STAGE: &str = "plan";

/// Drops the bands that the light does not ask for, unless the scene names them; says so.
pub fn bands(scene: &mut Scene, loaded: &Loaded, report: &mut Report) {
    if scene.origins.keys.contains_key("visibility.bands") {
        return;
    }
    let needed = plan::needed_bands(&loaded.light, scene.surface.as_ref()).min(scene.visibility.bands);
    if needed < scene.visibility.bands {
        report.line("bands", format!("{needed} of {}: the light asks for no more, the picture is the same", scene.visibility.bands));
        report.set("bands_dropped", json!(scene.visibility.bands - needed));
        scene.visibility.bands = needed;
    }
}

/// Plans the scene's field, says the plan, computes the field and says what came of it. The scene then holds the settings
/// that were used.
pub fn field(
    engine: &Engine,
    scene: &mut Scene,
    loaded: &Loaded,
    medium: &Medium,
    pixels: Option<(usize, usize)>,
    bar: &Progress,
    report: &mut Report,
) -> Result<Option<Made>, Failure> {
    let Some(wanted) = scene.wanted else { return Ok(None) };
    let given = |key: &str| scene.origins.keys.contains_key(key);
    let v = &scene.visibility;
    let request = Request {
        wanted,
        ratio: given("visibility.ratio").then_some(v.ratio),
        bits: given("visibility.bits").then_some(v.bits),
        bands: v.bands,
        cells: v.cells,
        pixels,
    };
    report.line(
        "planning",
        format!(
            "takes about {} s of device time, or {:.0} % of what the field will take if that is more; longer only where \
             to judge the tolerance takes a reference of more",
            plan::FLOOR_SECONDS,
            100.0 * plan::SHARE
        ),
    );
    report.flush()?;
    bar.enter(STAGE);
    let blame = |e| scene.origins.blame(e);
    let mut plan = plan::choose(engine, &loaded.volume, medium, &request, &mut bar.job()).map_err(blame)?;
    say(report, &plan);
    report.flush()?;
    bar.enter("visibility");
    let mut told = Ok(());
    let mut tell = |line: &str| {
        report.line("again", line);
        // Said before the next field is begun; a reader that has gone away is told of afterwards.
        told = report.flush();
    };
    let made = plan.compute(engine, medium, &mut tell, &mut bar.job()).map_err(blame)?;
    told?;
    let [lo, hi] = made.error.interval;
    report.line(
        "verified",
        format!(
            "{:.4} [{lo:.4}, {hi:.4}] at the plan's {} cells, in {:.1} s of device time",
            made.error.relative_l2,
            plan.probes(),
            made.seconds
        ),
    );
    let mut object = plan.json();
    if let Some(map) = object.as_object_mut() {
        map.insert("verified".into(), json!({ "error": made.error, "seconds": made.seconds, "missed": made.missed.len() }));
    }
    report.set("plan", object);
    scene.visibility = plan.settings.clone();
    scene.wanted = None;
    Ok(Some(made))
}

/// What was chosen, what it should cost, and why.
fn say(report: &mut Report, plan: &Plan) {
    let [lo, hi] = plan.predicted.interval;
    report.line("plan", plan.chosen());
    report.line(
        "predicted",
        format!(
            "error {:.4} [{lo:.4}, {hi:.4}] for a tolerance of {}; about {:.1} s of device time, {} of memory",
            plan.predicted.relative_l2,
            plan.tolerance,
            plan.seconds,
            bytes(plan.need.peak())
        ),
    );
    for reason in &plan.reasons {
        report.line("because", reason);
    }
    report.line(
        "planning",
        format!(
            "took {:.1} of about {:.1} s of device time, at {} cells near matter",
            plan.planning_seconds,
            plan.planning_limit,
            plan.probes()
        ),
    );
}
