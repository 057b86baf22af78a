//! The host's own device under the engine: same pictures, its lock around submissions and nothing else, its device left alive.

mod host;
mod kernels;
mod ledger;
mod pictures;
#[cfg(feature = "capi")]
mod through_c;
mod volumes;
mod work;

use ash::vk;
use halflight::engine::host::{Features, FormatNeed, HostDevice, HostDeviceParts, HostQueue, Requirements, lacking, requirements};
use halflight::engine::{DeviceVolume, Engine, Lit, Medium, Options};
use halflight::scene::{Camera, ImageSettings, Light, Matter, Picture, Probe, Visibility, Volume};
use halflight::vk::Format;
use halflight::{Error, demo};
use host::{Host, SEEN, all_features};
use std::ops::ControlFlow;
use std::sync::atomic::Ordering;
use work::{Bytes, Commands, Texels};

pub fn quiet(_: &'static str, _: f32) -> ControlFlow<()> {
    ControlFlow::Continue(())
}

pub fn own() -> Engine {
    Engine::new(&Options::default()).expect("a device")
}

pub fn on(host: &Host) -> Engine {
    Engine::on_host(&host.handed_over(), &Options::default()).expect("the host's device")
}

/// What a frame of a volume needs.
pub fn staged(engine: &Engine, volume: &DeviceVolume, matter: &Matter) -> (Medium, Lit, Camera, ImageSettings) {
    let medium = engine.classify(volume, matter).unwrap();
    let settings = Visibility { directions: 64, ..demo::visibility(true) };
    let field = engine.precompute(&medium, &settings, &mut quiet).unwrap();
    let lit = engine.relight(&field, &Light::from_probe(&Probe::two_colored())).unwrap();
    (medium, lit, demo::camera(volume.grid()), ImageSettings { width: 80, height: 60, ..ImageSettings::default() })
}

pub fn frame(engine: &Engine, volume: &DeviceVolume, matter: &Matter) -> Picture {
    let (medium, lit, camera, image) = staged(engine, volume, matter);
    engine.render(&medium, &lit, &camera, &image, &mut quiet).unwrap()
}

pub fn demo_frame(engine: &Engine, volume: &Volume) -> Picture {
    frame(engine, &engine.upload(volume).unwrap(), &demo::dvr().unwrap())
}

pub fn same_bits(a: &Picture, b: &Picture) -> bool {
    let bits = |p: &Picture| p.rgba.iter().flatten().map(|v| v.to_bits()).collect::<Vec<_>>();
    (a.width, a.height) == (b.width, b.height) && bits(a) == bits(b)
}

#[test]
fn the_picture_is_that_of_a_device_of_our_own() {
    let volume = demo::volume(32).unwrap();
    let ours = demo_frame(&own(), &volume);
    assert!(ours.rgba.iter().any(|p| p[3] > 0.5));
    let host = Host::new();
    let theirs = demo_frame(&on(&host), &volume);
    assert!(same_bits(&ours, &theirs));
    // Sabotage: another volume is told apart.
    assert!(!same_bits(&ours, &demo_frame(&on(&host), &demo::volume(28).unwrap())));
}

#[test]
fn the_lock_is_held_around_submissions_and_nothing_else() {
    let host = Host::new();
    let picture = demo_frame(&on(&host), &demo::volume(16).unwrap());
    assert!(picture.rgba.iter().any(|p| p[3] > 0.5));
    let [submits, locks, unlocks] = [&SEEN.submits, &SEEN.locks, &SEEN.unlocks].map(|c| c.load(Ordering::SeqCst));
    println!("{submits} submissions");
    assert!(submits > 20 && locks == submits && unlocks == submits, "{submits} {locks} {unlocks}");
    assert_eq!(SEEN.unguarded.load(Ordering::SeqCst), 0);
    assert_eq!(SEEN.others.load(Ordering::SeqCst), 0);
    // Sabotage: without the lock the hooks see unguarded submissions.
    // SAFETY: as in `handed_over`; nobody else uses the queue here.
    let unlocked = unsafe { HostDevice::new(HostDeviceParts { lock: None, ..host.parts() }) };
    drop(Engine::on_host(&unlocked, &Options::default()).unwrap());
    assert!(SEEN.unguarded.load(Ordering::SeqCst) > 0);
}

#[test]
fn host_and_engines_share_one_queue() {
    let host = Host::new();
    let volume = demo::volume(16).unwrap();
    let expected = demo_frame(&own(), &volume);
    let pattern: Vec<u8> = (0..4096u32).map(|i| (i * 7) as u8).collect();
    let done = std::sync::atomic::AtomicBool::new(false);
    std::thread::scope(|scope| {
        let engines: Vec<_> =
            (0..2).map(|_| scope.spawn(|| (0..2).all(|_| same_bits(&demo_frame(&on(&host), &volume), &expected)))).collect();
        let own_work = scope.spawn(|| {
            let mut rounds = 0;
            while !done.load(Ordering::SeqCst) {
                let (from, to) = (Bytes::of(&host, &pattern), Bytes::new(&host, 4096));
                let texels = Texels::new(&host, vk::Format::R8_UNORM, [64, 64, 1]);
                let commands = Commands::begin(&host);
                texels.fill(&commands, &from, vk::ImageLayout::GENERAL);
                texels.drain(&commands, vk::ImageLayout::GENERAL, &to);
                commands.submit(None, None);
                drop(commands);
                assert_eq!(to.read(), pattern);
                rounds += 1;
            }
            rounds
        });
        let same: Vec<bool> = engines.into_iter().map(|e| e.join().unwrap()).collect();
        done.store(true, Ordering::SeqCst);
        println!("the host submitted {} times meanwhile", own_work.join().unwrap());
        assert_eq!(same, [true, true]);
    });
    assert_eq!(SEEN.locks.load(Ordering::SeqCst), SEEN.unlocks.load(Ordering::SeqCst));
}

#[test]
fn the_hosts_device_outlives_the_engine() {
    let host = Host::new();
    let engine = on(&host);
    let volume = engine.upload(&demo::volume(16).unwrap()).unwrap();
    // What was made from an engine keeps our part alive, not the host's.
    drop(engine);
    drop(volume);
    for _ in 0..3 {
        drop(on(&host));
    }
    let data = vec![9; 256];
    let (from, to) = (Bytes::of(&host, &data), Bytes::new(&host, 256));
    let texels = Texels::new(&host, vk::Format::R8_UNORM, [16, 16, 1]);
    let commands = Commands::begin(&host);
    texels.fill(&commands, &from, vk::ImageLayout::GENERAL);
    texels.drain(&commands, vk::ImageLayout::GENERAL, &to);
    commands.submit(None, None);
    drop(commands);
    assert_eq!(to.read(), data);
}

#[test]
fn what_a_host_lacks_is_said_in_one_sentence() {
    let host = Host::new();
    let refused = |change: &dyn Fn(&mut HostDeviceParts), options: &Options| {
        let mut parts = host.parts();
        change(&mut parts);
        // SAFETY: true, save for what is refused before it is used.
        let error = Engine::on_host(&unsafe { HostDevice::new(parts) }, options).err().expect("refused");
        let text = error.to_string();
        assert!(!text.contains('\n') && text.len() < 300, "{text}");
        println!("{text}");
        (error, text)
    };
    let plain = Options::default();
    let without = Features::from_bits(all_features().bits() & !(Features::SYNCHRONIZATION2.bits() | Features::MAINTENANCE4.bits()));
    let (error, text) = refused(&|p| p.features = without, &plain);
    assert!(matches!(error, Error::DeviceLacks { .. }));
    assert!(text.contains("synchronization2, maintenance4, which the host has not enabled"), "{text}");
    assert!(refused(&|p| p.api_version = vk::API_VERSION_1_2, &plain).1.contains("made for 1.2"));
    assert!(refused(&|p| p.device = 0, &plain).1.contains("VkDevice is null"));
    assert!(refused(&|p| p.instance = 0, &plain).1.contains("VkInstance is null"));
    assert!(refused(&|p| p.queues.clear(), &plain).1.contains("a queue of a family that computes"));
    assert!(refused(&|p| p.queues = vec![HostQueue { family: 7, index: 0, flags: 0 }], &plain).1.contains("queue 0 of family 7"));
    assert!(refused(&|_| (), &Options { validation: true, ..Options::default() }).1.contains("'validation' is set"));
    assert!(refused(&|_| (), &Options { threads: Some(2), ..Options::default() }).1.contains("'threads' is set"));

    let parts = host.parts();
    let ask = |requirements: &Requirements| {
        // SAFETY: the host's own.
        unsafe { lacking(parts.get_instance_proc_addr, parts.instance, parts.physical_device, parts.api_version, requirements) }.unwrap()
    };
    assert_eq!(ask(&requirements()), None);
    assert!(requirements().device_extensions.is_empty() && requirements().features.iter().filter(|f| f.required).count() == 4);
    // Sabotage: more than there is.
    const TOO_MUCH: [FormatNeed; 1] = [FormatNeed::filtered(Format::R32Uint)];
    let text = ask(&Requirements { api_version: vk::make_api_version(0, 9, 1, 0), ..Requirements::with_formats(&TOO_MUCH) });
    let text = text.expect("something lacks");
    println!("{text}");
    assert!(text.contains("Vulkan 9.1 (it has 1.") && text.contains("linear filtering of R32Uint"), "{text}");
}
