// The measurements "field" of reference.cpp from Rust without crates, through the C header alone.
use std::ffi::{c_char, c_void, CString};

const WIDTH: usize = 160;
const HEIGHT: usize = 120;

#[repr(C)]
struct Error { code: i32, text: [c_char; 508] }
#[repr(C)]
struct Pose { translation: [f64; 3], rotation: [f64; 4] }
#[repr(C)]
struct Camera { size: u32, width: i32, height: i32, intrinsics: [f64; 4], distortion: [f64; 8] }
#[repr(C)]
struct Measure {
    size: u32, wants: u32, progress: f64, states: *mut u8, planes: *mut f32, status: u32, num_boundary: i32, num_inside: i32,
    volume: f64, potential: f64, force: [f64; 3], torque: [f64; 3], stiffness: [f64; 36], sigma: [f64; 7], moments: [f64; 9],
    polar_moment: f64, bodies_volume: f64,
}

#[link(name = "palpate_c")]
extern "C" {
    fn palpate_tool_pack_shape(shape: *const c_char, size: f64, options: *const c_char, error: *mut Error) -> *mut c_void;
    fn palpate_tool_free(tool: *mut c_void);
    fn palpate_sensor_create(camera: *const Camera, options: *const c_char, threads: i32, error: *mut Error) -> *mut c_void;
    fn palpate_sensor_free(sensor: *mut c_void);
    fn palpate_sensor_update_counts(
        sensor: *mut c_void, counts: *const u16, unit: f64, pose: *const Pose, error: *mut Error) -> i32;
    fn palpate_scene_create(error: *mut Error) -> *mut c_void;
    fn palpate_scene_free(scene: *mut c_void);
    fn palpate_scene_add_sensor(scene: *mut c_void, sensor: *const c_void, error: *mut Error) -> i32;
    fn palpate_contact_create(tool: *const c_void, options: *const c_char, threads: i32, error: *mut Error) -> *mut c_void;
    fn palpate_contact_free(contact: *mut c_void);
    fn palpate_contact_measure(
        contact: *mut c_void, scene: *const c_void, pose: *const Pose, measure: *mut Measure, error: *mut Error) -> i32;
}

fn pose(i: usize) -> Pose {
    let i = i as f64;
    let (x, y, z, w) = (0.1 * i, 0.05, 0.0, 1.0);
    let length = f64::sqrt(x * x + y * y + z * z + w * w);
    Pose {
        translation: [0.004 * i - 0.01, 0.003 * i, 0.54 + 0.01 * i],
        rotation: [x / length, y / length, z / length, w / length],
    }
}

fn main() {
    let mut counts = Vec::new();
    for v in 0..HEIGHT {
        for u in 0..WIDTH {
            let depth = (if u > 90 { 560 } else { 600 }) + (u * u / 37 + v * v / 53) % 5;
            counts.push(if (u * 31 + v * 17) % 97 == 0 { 0 } else { depth as u16 });
        }
    }
    let (shape, options) = (CString::new("stylus").unwrap(), CString::new("packing.spheres = 300").unwrap());
    let size = |bytes: usize| bytes as u32;
    let camera = Camera {
        size: size(std::mem::size_of::<Camera>()), width: WIDTH as i32, height: HEIGHT as i32,
        intrinsics: [140.0, 140.0, 79.5, 59.5], distortion: [0.0; 8],
    };
    unsafe {
        let mut error: Error = std::mem::zeroed();
        let tool = palpate_tool_pack_shape(shape.as_ptr(), 0.12, options.as_ptr(), &mut error);
        let sensor = palpate_sensor_create(&camera, std::ptr::null(), 0, &mut error);
        palpate_sensor_update_counts(sensor, counts.as_ptr(), 0.001, std::ptr::null(), &mut error);
        let scene = palpate_scene_create(&mut error);
        palpate_scene_add_sensor(scene, sensor, &mut error);
        let contact = palpate_contact_create(tool, std::ptr::null(), 0, &mut error);
        for i in 0..5 {
            let mut m: Measure = std::mem::zeroed();
            m.size = size(std::mem::size_of::<Measure>());
            m.wants = 1;
            m.progress = 1.0;
            palpate_contact_measure(contact, scene, &pose(i), &mut m, &mut error);
            let mut numbers = vec![m.volume, m.potential];
            numbers.extend(m.force);
            numbers.extend(m.torque);
            numbers.extend([m.stiffness[14], m.stiffness[22]]);
            let words: Vec<String> = numbers.iter().map(|n| format!("{:016x}", n.to_bits())).collect();
            println!("field {}", words.join(" "));
        }
        palpate_contact_free(contact);
        palpate_scene_free(scene);
        palpate_sensor_free(sensor);
        palpate_tool_free(tool);
    }
}
