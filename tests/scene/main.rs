//! Scene files: every key, every default, every refusal.

mod meaning;
mod reading;
mod refusals;

use glam::DVec3;
use halflight::io::{parse_scene, read_scene, scene_of_volume, scene_text};
use halflight::scene::animation::{Ease, Keyframe, Track};
use halflight::scene::camera::{CameraSettings, Space};
use halflight::scene::keys;
use halflight::scene::scene::{
    Background, ImageSettings, LightSettings, LightSource, Matter, Scene, Shading, Surface, TransferSource, Windowing, fill_background,
    ramp,
};
use halflight::scene::transfer::{Kind, Reference};
use halflight::scene::visibility::{Cells, Filter, Method, Sampling};
use halflight::scene::{Animation, Camera, Clip, Grid, Light, Picture, Probe, Visibility};
use std::path::{Path, PathBuf};

fn parse(text: &str) -> Result<Scene, String> {
    parse_scene(text, "s.toml", Path::new("/scenes"), &[]).map_err(|e| e.to_string())
}

fn with(text: &str, overrides: &[(&str, &str)]) -> Result<Scene, String> {
    parse_scene(text, "s.toml", Path::new("/scenes"), overrides).map_err(|e| e.to_string())
}

const FULL: &str = r#"
[volume]
file = "ct.raw"
component = "0"
series = "1.2.3"
dims = [4, 5, 6]
type = "int16"
spacing = [1, 1.5, 2]
endian = "big"
offset = 128
nan_as = -3.5

[transfer]
reference = "side"
points = [[0, 0.1, 0.2, 0.3, 0.0], [100.5, 1, 1, 1, 8.0]]
kind = "extinction"

[surface]
iso = 42
shading = "isotropic"
albedo = [0.5, 0.25, 1]

[light]
probe = "sky.hdr"
rotate = [0, 0, 2, 90]
scale = 2.5
bands = 3
window = "hanning"

[visibility]
method = "march"
ratio = 2
directions = 128
bands = 2
bits = 16
filter = "product"
sampling = "jittered"
growth = 0.5
step = 0.25
near = 3
fit = 0
cells = "all"

[camera]
position = [1, 2, 3]
target = [0.5, 0, 0]
up = [0, 1, 0]
fov = 45
space = "world"
orbit = [0, 0, 2, 30]
centre = [1, 1, 1]
distance = 4

[image]
width = 320
height = 200
step = 0.5
background = [0, 0.5, 1]
exposure = -1.5
skip = false

[clip]
box = [0, 0.25, 0, 1, 1, 0.5]
planes = [[0, 0, 1, 2]]
space = "world"

[animation]
frames = 9
first = 3
rate = 30
ease = "hold"
keyframe = [{ frame = 4, camera.fov = 45 }]
"#;
