//! GLSL to SPIR-V 1.6, by `glslc` or, with the feature `shaderc`, in process.

use std::path::{Path, PathBuf};

/// A compiler with its include folders.
pub struct Compiler {
    includes: [PathBuf; 2],
    /// What it says of itself, in one line.
    pub version: String,
    #[cfg(not(feature = "shaderc"))]
    program: std::ffi::OsString,
    #[cfg(feature = "shaderc")]
    inner: shaderc::Compiler,
}

#[cfg(not(feature = "shaderc"))]
impl Compiler {
    pub fn new(glsl: &Path, out: &Path) -> Result<Self, String> {
        let program = std::env::var_os("GLSLC").unwrap_or_else(|| "glslc".into());
        match std::process::Command::new(&program).arg("--version").output() {
            Ok(said) => Ok(Self {
                includes: [glsl.to_owned(), out.to_owned()],
                version: String::from_utf8_lossy(&said.stdout).lines().collect::<Vec<_>>().join(", "),
                program,
            }),
            Err(e) => Err(format!(
                "cannot run the GLSL compiler '{}': {e}. Install it (`apt-get install glslc`, or the Vulkan SDK), or name it in the \
                 environment variable GLSLC, or build with the cargo feature `shaderc`",
                Path::new(&program).display()
            )),
        }
    }

    /// The words of one kernel. Optimisation strips the names that reflection needs.
    pub fn compile(&self, source: &Path, optimise: bool) -> Result<Vec<u32>, String> {
        let name = source.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        let target = self.includes[1].join(format!("{name}.{}.spv", if optimise { "opt" } else { "plain" }));
        let output = std::process::Command::new(&self.program)
            .args(["--target-env=vulkan1.3", "-fshader-stage=compute", if optimise { "-O" } else { "-O0" }])
            .args(self.includes.iter().flat_map(|folder| [std::ffi::OsStr::new("-I"), folder.as_os_str()]))
            .arg("-o")
            .arg(&target)
            .arg(source)
            .output()
            .map_err(|e| format!("{}: cannot run the GLSL compiler: {e}", source.display()))?;
        if !output.status.success() {
            return Err(String::from_utf8_lossy(&output.stderr).into_owned());
        }
        let bytes = std::fs::read(&target).map_err(|e| format!("{}: cannot read: {e}", target.display()))?;
        Ok(bytes.chunks_exact(4).map(|b| u32::from_le_bytes([b[0], b[1], b[2], b[3]])).collect())
    }
}

#[cfg(feature = "shaderc")]
impl Compiler {
    pub fn new(glsl: &Path, out: &Path) -> Result<Self, String> {
        let inner = shaderc::Compiler::new().map_err(|e| format!("shaderc does not start: {e}"))?;
        // Its version is the lock's.
        Ok(Self { includes: [glsl.to_owned(), out.to_owned()], version: "shaderc".into(), inner })
    }

    /// The words of one kernel. Optimisation strips the names that reflection needs.
    pub fn compile(&self, source: &Path, optimise: bool) -> Result<Vec<u32>, String> {
        let text = std::fs::read_to_string(source).map_err(|e| format!("{}: cannot read: {e}", source.display()))?;
        let mut options = shaderc::CompileOptions::new().map_err(|e| format!("shaderc does not start: {e}"))?;
        options.set_target_env(shaderc::TargetEnv::Vulkan, shaderc::EnvVersion::Vulkan1_3 as u32);
        options.set_optimization_level(if optimise { shaderc::OptimizationLevel::Performance } else { shaderc::OptimizationLevel::Zero });
        options.set_include_callback(|wanted, _, from, _| {
            self.includes
                .iter()
                .map(|folder| folder.join(wanted))
                .find_map(|path| {
                    let content = std::fs::read_to_string(&path).ok()?;
                    Some(shaderc::ResolvedInclude { resolved_name: path.display().to_string(), content })
                })
                .ok_or_else(|| format!("{from}: no file '{wanted}' in {}", self.includes[0].display()))
        });
        self.inner
            .compile_into_spirv(&text, shaderc::ShaderKind::Compute, &source.display().to_string(), "main", Some(&options))
            .map(|artifact| artifact.as_binary().to_vec())
            .map_err(|e| e.to_string())
    }
}
