//! Does the device run long loops to their end? Mesa's llvmpipe before version 23 leaves them after 65,535 iterations and says nothing.

use super::Device;
use crate::error::{Error, Result};
use crate::kernels::canary;

/// More than the known bound.
const TRIPS: u32 = 70_000;
/// What is used where loops run to their end: a bound on the time of one invocation, not on the device.
const UNBOUNDED: u32 = 1 << 20;
/// Below the known bound, with room for a kernel's small outer loops.
const BOUNDED: u32 = 60_000;

/// Less than this, a ray's parts would be too many.
const LEAST: u32 = 1 << 14;

/// Iterations that one invocation may make, over all its loops.
pub(super) fn loop_limit(device: &Device) -> Result<u32> {
    let counted = device.buffer::<u32>("canary", 2)?;
    let mut rec = device.record()?;
    rec.dispatch(&canary::Bindings { counted: &counted }, &(), &canary::Params { trips: TRIPS }, [1, 1, 1])?;
    rec.submit()?;
    let count = device.read::<u32>(&counted, 1)?.first().copied().unwrap_or(0);
    // The user asked for the time of his own kernels.
    device.take_timings();
    if count == TRIPS {
        return Ok(UNBOUNDED);
    }
    let limit = BOUNDED.min(count / 16 * 15);
    if limit < LEAST {
        let lacks = format!("loops of {LEAST} iterations (they stop after {count})");
        return Err(Error::DeviceLacks { device: device.info().name.clone(), lacks });
    }
    log::info!("{}: loops stop after {count} iterations; dispatches are bounded to {limit}", device.info().name);
    Ok(limit)
}
