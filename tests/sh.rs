//! Spherical harmonics against theory: each closed form is judged by quadrature or by a second, independent recursion.

use glam::{DMat3, DQuat, DVec3};
use halflight::scene::sh::{self, Rotation, Window};
use std::f64::consts::PI;

/// Directions without any pattern, poles included.
fn directions(n: usize) -> Vec<DVec3> {
    let mut state = 0x9e37_79b9_7f4a_7c15_u64;
    let mut random = move || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as f64 / (1u64 << 53) as f64
    };
    let mut all = vec![DVec3::Z, -DVec3::Z, DVec3::X, -DVec3::Y];
    all.extend((0..n).map(|_| {
        let (z, phi) = (2.0 * random() - 1.0, 2.0 * PI * random());
        let r = (1.0 - z * z).sqrt();
        DVec3::new(r * phi.cos(), r * phi.sin(), z)
    }));
    all
}

fn coefficients(seed: usize) -> [f64; 16] {
    std::array::from_fn(|i| ((i * 37 + seed * 101 + 11) % 23) as f64 / 11.0 - 1.0)
}

fn evaluate(c: &[f64; 16], dir: DVec3) -> f64 {
    sh::basis(dir).iter().zip(c).map(|(y, c)| y * c).sum()
}

fn largest_difference(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

#[test]
fn index_and_back() {
    let mut next = 0;
    for l in 0..7usize {
        for m in -(l as i32)..=l as i32 {
            assert_eq!(sh::index(l, m), next);
            assert_eq!(sh::band_and_order(next), (l, m));
            next += 1;
        }
    }
}

#[test]
fn signs_are_sloans() {
    let c1 = (3.0 / (4.0 * PI)).sqrt();
    let y = sh::basis(DVec3::new(0.6, 0.48, 0.64));
    assert!((y[1] + c1 * 0.48).abs() < 1e-15 && (y[2] - c1 * 0.64).abs() < 1e-15 && (y[3] + c1 * 0.6).abs() < 1e-15);
    assert!((y[9] + (35.0 / (32.0 * PI)).sqrt() * 0.48 * (3.0 * 0.36 - 0.2304)).abs() < 1e-15);
    // The same series with l = 1 signs turned over is another function: the comparison above can fail.
    assert!((y[1] - c1 * 0.48).abs() > 0.1);
}

#[test]
fn closed_forms_equal_the_recursion() {
    for dir in directions(500) {
        let mut y = [f64::NAN; 16];
        sh::basis_up_to(3, dir, &mut y);
        assert!(largest_difference(&y, &sh::basis(dir)) < 1e-14, "{dir}");
    }
    // A slip of one part in 10⁶ in the direction shows.
    let (a, b) = (DVec3::new(0.6, 0.0, 0.8), DVec3::new(0.6 + 1e-6, 0.0, 0.8));
    let mut y = [0.0; 16];
    sh::basis_up_to(3, b, &mut y);
    assert!(largest_difference(&y, &sh::basis(a)) > 1e-7);
}

#[test]
fn a_short_slice_is_filled_and_nothing_else() {
    let mut y = [7.0; 10];
    sh::basis_up_to(6, DVec3::X, &mut y);
    assert!(largest_difference(&y, &sh::basis(DVec3::X)[..10]) < 1e-14);
    let mut y = [7.0; 10];
    sh::basis_up_to(1, DVec3::X, &mut y);
    assert_eq!(y[4..], [7.0; 6]);
}

#[test]
fn orthonormal_to_band_six() {
    let mut gram = vec![0.0; 49 * 49];
    let mut y = [0.0; 49];
    // A plain grid of midpoints, not the exact quadrature, and a bound that its own error explains.
    let (rows, columns) = (2000, 16);
    for j in 0..rows {
        let theta = PI * (j as f64 + 0.5) / rows as f64;
        for k in 0..columns {
            let phi = 2.0 * PI * k as f64 / columns as f64;
            sh::basis_up_to(6, DVec3::new(theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos()), &mut y);
            let weight = theta.sin() * PI / rows as f64 * 2.0 * PI / columns as f64;
            for a in 0..49 {
                for b in 0..49 {
                    gram[a * 49 + b] += weight * y[a] * y[b];
                }
            }
        }
    }
    for a in 0..49 {
        for b in 0..49 {
            let expected = if a == b { 1.0 } else { 0.0 };
            assert!((gram[a * 49 + b] - expected).abs() < 1e-5, "{a} {b}: {}", gram[a * 49 + b]);
        }
    }
}

#[test]
fn addition_theorem() {
    // Σ_m Y_lm² = (2l+1)/4π in every direction.
    let mut y = [0.0; 49];
    for dir in directions(100) {
        sh::basis_up_to(6, dir, &mut y);
        for l in 0..7 {
            let sum: f64 = y[l * l..(l + 1) * (l + 1)].iter().map(|y| y * y).sum();
            assert!((sum - (2 * l + 1) as f64 / (4.0 * PI)).abs() < 1e-13, "l {l} at {dir}: {sum}");
        }
    }
}

#[test]
fn quadrature_is_exact_to_its_degree_and_not_beyond() {
    for degree in 0..14 {
        let nodes = sh::sphere_quadrature(degree);
        assert!((nodes.iter().map(|n| n.1).sum::<f64>() - 4.0 * PI).abs() < 1e-13);
        // ∫ z^d dω = 4π/(d+1) for even d; ∫ x^d the same by symmetry.
        let even = degree - degree % 2;
        for axis in 0..3 {
            let moment: f64 = nodes.iter().map(|(d, w)| w * d[axis].powi(even as i32)).sum();
            assert!((moment - 4.0 * PI / (even + 1) as f64).abs() < 1e-13, "degree {degree} axis {axis}");
        }
    }
    let beyond: f64 = sh::sphere_quadrature(4).iter().map(|(d, w)| w * d.z.powi(6)).sum();
    assert!((beyond - 4.0 * PI / 7.0).abs() > 1e-3);
}

#[test]
fn zonal_coefficients_are_their_integrals() {
    // 2π ∫ f(t) Y_l0(t) dt over the half-space, by Gauss–Legendre on 0..1, where both functions are polynomials.
    for l in 0..=12 {
        let norm = ((2 * l + 1) as f64 / (4.0 * PI)).sqrt();
        let integral = |f: fn(f64) -> f64| -> f64 {
            sh::gauss_legendre(16)
                .iter()
                .map(|(t, w)| (0.5 * (t + 1.0), 0.5 * w))
                .map(|(t, w)| 2.0 * PI * w * f(t) * norm * sh::legendre(l, t))
                .sum()
        };
        assert!((sh::zonal_clamped_cosine(l) - integral(|t| t)).abs() < 1e-13, "cosine, l {l}");
        assert!((sh::zonal_half_space(l) - integral(|_| 1.0)).abs() < 1e-13, "step, l {l}");
    }
    // Ramamoorthi & Hanrahan 2001: A_0 = π, A_1 = 2π/3, A_2 = π/4, A_4 = −π/24, as √(4π/(2l+1))·h_l.
    for (l, a) in [(0, PI), (1, 2.0 * PI / 3.0), (2, PI / 4.0), (3, 0.0), (4, -PI / 24.0), (5, 0.0), (6, PI / 64.0)] {
        assert!((sh::zonal_scale(l) * sh::zonal_clamped_cosine(l) - a).abs() < 1e-14, "l {l}");
    }
    // A half-space: 2π·Y00 and √(3/4π)·π.
    assert!((sh::zonal_half_space(0) - PI.sqrt()).abs() < 1e-15 && (sh::zonal_half_space(1) - (0.75 * PI).sqrt()).abs() < 1e-15);
    assert!((sh::zonal_cone(0, -1.0) - (4.0 * PI).sqrt()).abs() < 1e-15 && sh::zonal_cone(3, 1.0).abs() < 1e-15);
}

#[test]
fn a_half_space_about_any_normal() {
    // The opaque half-space in closed form against a brute-force projection on a fine grid.
    let n = DVec3::new(0.48, -0.6, 0.64);
    let mut brute = [0.0; 16];
    let count = 200_000;
    for i in 0..count {
        // Spherical Fibonacci points.
        let z = 1.0 - (2 * i + 1) as f64 / count as f64;
        let phi = 2.0 * PI * (i as f64 * 0.618_033_988_749_894_8).fract();
        let dir = DVec3::new((1.0 - z * z).sqrt() * phi.cos(), (1.0 - z * z).sqrt() * phi.sin(), z);
        if dir.dot(n) > 0.0 {
            for (b, y) in brute.iter_mut().zip(sh::basis(dir)) {
                *b += y * 4.0 * PI / count as f64;
            }
        }
    }
    let closed: [f64; 16] = std::array::from_fn(|i| sh::zonal_scale(i.isqrt()) * sh::zonal_half_space(i.isqrt()) * sh::basis(n)[i]);
    assert!(largest_difference(&brute, &closed) < 1e-3, "{brute:?} {closed:?}");
    let mirrored: [f64; 16] = std::array::from_fn(|i| sh::zonal_scale(i.isqrt()) * sh::zonal_half_space(i.isqrt()) * sh::basis(-n)[i]);
    assert!(largest_difference(&brute, &mirrored) > 0.5);
}

#[test]
fn rotation_turns_the_function() {
    let turn = DMat3::from_quat(DQuat::from_axis_angle(DVec3::new(0.3, -0.5, 0.8).normalize(), 1.234));
    let c = coefficients(1);
    let turned = Rotation::new(turn).apply(&c);
    for dir in directions(200) {
        assert!((evaluate(&turned, dir) - evaluate(&c, turn.transpose() * dir)).abs() < 1e-12);
    }
    // The inverse rotation is another one: the comparison sees which way it turns.
    let wrong = Rotation::new(turn.transpose()).apply(&c);
    assert!(directions(200).iter().any(|&d| (evaluate(&wrong, d) - evaluate(&c, turn.transpose() * d)).abs() > 0.1));
}

#[test]
fn rotation_there_and_back_and_in_two_parts() {
    let a = DMat3::from_quat(DQuat::from_axis_angle(DVec3::new(-0.7, 0.2, 0.1).normalize(), 2.9));
    let b = DMat3::from_quat(DQuat::from_axis_angle(DVec3::new(0.1, 0.9, -0.4).normalize(), -0.77));
    let c = coefficients(2);
    let back = Rotation::new(a.transpose()).apply(&Rotation::new(a).apply(&c));
    assert!(largest_difference(&back, &c) < 1e-12);
    let (parts, whole) = (Rotation::new(b).apply(&Rotation::new(a).apply(&c)), Rotation::new(b * a).apply(&c));
    assert!(largest_difference(&parts, &whole) < 1e-12);
    for l in 0..4 {
        let norm = |c: &[f64; 16]| c[l * l..(l + 1) * (l + 1)].iter().map(|x| x * x).sum::<f64>();
        assert!((norm(&c) - norm(&whole)).abs() < 1e-12, "band {l} keeps its energy");
    }
}

#[test]
fn a_quarter_turn_about_z_by_hand() {
    // f = −Y_11/c = x becomes f(R⁻¹ω) = y: coefficient of Y_11 moves to Y_1−1.
    let mut c = [0.0; 16];
    c[3] = 1.0;
    let turned = Rotation::new(DMat3::from_rotation_z(PI / 2.0)).apply(&c);
    let mut expected = [0.0; 16];
    expected[1] = 1.0;
    assert!(largest_difference(&turned, &expected) < 1e-14);
}

#[test]
fn windows_damp_from_one_to_nothing() {
    for window in [Window::None, Window::Hanning(4.0), Window::Lanczos(4.0), Window::Gauss(4.0)] {
        assert_eq!(window.factor(0), 1.0);
        for l in 0..6 {
            assert!(window.factor(l + 1) <= window.factor(l) && window.factor(l) >= 0.0, "{window:?} {l}");
        }
    }
    assert!((Window::Hanning(4.0).factor(2) - 0.5).abs() < 1e-15);
    assert!((Window::Lanczos(4.0).factor(2) - 2.0 / PI).abs() < 1e-15);
    assert!((Window::Gauss(4.0).factor(2) - (-PI * PI / 32.0).exp()).abs() < 1e-15);
    assert_eq!((Window::Hanning(2.0).factor(2), Window::Lanczos(2.0).factor(3)), (0.0, 0.0));
    for broken in [Window::Hanning(0.0), Window::Lanczos(-1.0), Window::Gauss(f64::NAN)] {
        assert_eq!((broken.factor(0), broken.factor(1)), (1.0, 0.0), "{broken:?}");
    }
}

#[test]
fn a_window_takes_the_ringing_of_a_half_space() {
    let series = |window: Window, t: f64| -> f64 {
        (0..4).map(|l| window.factor(l) * sh::zonal_half_space(l) * ((2 * l + 1) as f64 / (4.0 * PI)).sqrt() * sh::legendre(l, t)).sum()
    };
    let lowest = |window| (0..=200).map(|i| series(window, -1.0 + 0.01 * i as f64)).fold(f64::MAX, f64::min);
    let (none, wide, narrow) = (lowest(Window::None), lowest(Window::Hanning(4.0)), lowest(Window::Hanning(2.0)));
    // ½ − ¾·½ at the far pole: with two bands at half strength the series is nowhere negative.
    assert!(none < -0.11 && wide > 0.7 * none && (narrow - 0.125).abs() < 1e-12, "{none} {wide} {narrow}");
}

#[test]
fn gaunt_coefficients() {
    // One factor constant: Y00·δ. The table value ∫Y20³ = √5/(7√π).
    let y00 = (0.25 / PI).sqrt();
    for i in 0..16 {
        for k in 0..16 {
            assert!((sh::gaunt(i, 0, k) - if i == k { y00 } else { 0.0 }).abs() < 1e-14);
        }
    }
    assert!((sh::gaunt(6, 6, 6) - 5f64.sqrt() / (7.0 * PI.sqrt())).abs() < 1e-14);
    assert!((sh::gaunt(2, 2, 6) - 1.0 / (5.0 * PI).sqrt()).abs() < 1e-14, "∫ Y10² Y20 = 1/√(5π)");
    // Symmetric under exchange, and the product really is the product: Σ_k G_ijk Y_k = Y_i Y_j.
    let mut y = [0.0; 49];
    let dir = DVec3::new(0.48, 0.6, -0.64);
    sh::basis_up_to(6, dir, &mut y);
    for i in 0..16 {
        for j in 0..16 {
            let product: f64 = (0..49).map(|k| sh::gaunt(i, j, k) * y[k]).sum();
            assert!((product - y[i] * y[j]).abs() < 1e-12, "{i} {j}: {product}");
            assert!((sh::gaunt(i, j, 20) - sh::gaunt(20, j, i)).abs() < 1e-13);
        }
    }
}

/// ∫ V L max(0, n·ω) dω by a quadrature that lies in the hemisphere of n, where the integrand is a polynomial.
fn irradiance(v: &[f64; 16], light: &[f64; 16], n: DVec3) -> f64 {
    let frame = DMat3::from_quat(DQuat::from_rotation_arc(DVec3::Z, n));
    let turns = 16;
    let mut sum = 0.0;
    for (t, w) in sh::gauss_legendre(8) {
        let z = 0.5 * (t + 1.0);
        for k in 0..turns {
            let phi = 2.0 * PI * k as f64 / turns as f64;
            let dir = frame * DVec3::new((1.0 - z * z).sqrt() * phi.cos(), (1.0 - z * z).sqrt() * phi.sin(), z);
            sum += 0.5 * w * 2.0 * PI / turns as f64 * z * evaluate(v, dir) * evaluate(light, dir);
        }
    }
    sum
}

#[test]
fn lambert_matrix_is_the_brute_force_integral() {
    let channels = [coefficients(3), coefficients(4), coefficients(5)];
    let light: [[f64; 3]; 16] = std::array::from_fn(|j| std::array::from_fn(|c| channels[c][j]));
    let matrix = sh::lambert_matrix(&light);
    let kept: Vec<usize> = sh::lambert_rows().collect();
    assert_eq!(kept.len(), 1 + 3 + 5 + 9 + 13);
    assert!(kept.iter().all(|k| ![3, 5].contains(&k.isqrt())));
    let v = coefficients(6);
    let shade = |n: DVec3, rows: &[usize], c: usize| -> f64 {
        let lobe = sh::lambert_lobe(n);
        rows.iter().map(|&k| lobe[k] * (0..16).map(|i| matrix[k][i][c] * v[i]).sum::<f64>()).sum()
    };
    for n in directions(20) {
        for (c, light) in channels.iter().enumerate() {
            let truth = irradiance(&v, light, n);
            assert!((shade(n, &kept, c) - truth).abs() < 1e-12, "{n} {c}: {} {truth}", shade(n, &kept, c));
        }
    }
    // Without band 6 it is only close; the comparison sees that.
    let short: Vec<usize> = kept.iter().copied().filter(|k| k.isqrt() < 6).collect();
    let n = DVec3::new(0.6, -0.48, 0.64);
    assert!((shade(n, &short, 0) - irradiance(&v, &channels[0], n)).abs() > 1e-5);
    // And the matrix is Σ_j G_ijk L_j.
    for (k, i) in [(0, 0), (7, 3), (20, 10), (40, 15)] {
        let sum: f64 = (0..16).map(|j| sh::gaunt(i, j, k) * channels[1][j]).sum();
        assert!((matrix[k][i][1] - sum).abs() < 1e-13);
    }
}

#[test]
fn white_light_and_open_sky_give_pi() {
    let mut light = [[0.0; 3]; 16];
    light[0] = [(4.0 * PI).sqrt(); 3];
    let matrix = sh::lambert_matrix(&light);
    let lobe = sh::lambert_lobe(DVec3::new(0.6, 0.0, 0.8));
    let irradiance: f64 = (0..49).map(|k| lobe[k] * matrix[k][0][0] * (4.0 * PI).sqrt()).sum();
    assert!((irradiance - PI).abs() < 1e-13);
}

#[test]
fn the_kernels_file_states_the_same_numbers() {
    // Reads the GLSL as arithmetic: every `y[i] = …;` is evaluated and compared with the twin.
    let text = include_str!("../glsl/sh.glsl");
    let dir = DVec3::new(0.48, -0.6, 0.64);
    let check = |text: &str| -> f64 {
        let mut y = [f64::NAN; 16];
        for line in text.lines().filter_map(|l| l.trim().strip_prefix("y[")) {
            let (i, rest) = line.split_once("] = ").unwrap();
            let expression = rest.trim_end_matches(';').replace("d.x", "x").replace("d.y", "y").replace("d.z", "z");
            y[i.parse::<usize>().unwrap()] =
                sum(&mut expression.replace("c2", "(x * x - y * y)").replace("zz", "z * z").chars().filter(|c| *c != ' ').peekable(), dir);
        }
        largest_difference(&y, &sh::basis(dir)) + if y.iter().all(|y| y.is_finite()) { 0.0 } else { f64::INFINITY }
    };
    assert!(check(text) < 1e-14, "{}", check(text));
    assert!(check(&text.replace("2.8906", "2.8907")) > 1e-6);
    assert!(check(&text.replace("y[1] = -", "y[1] = ")) > 0.1);
}

fn sum(c: &mut std::iter::Peekable<impl Iterator<Item = char>>, d: DVec3) -> f64 {
    let mut value = product(c, d);
    while let Some(&op) = c.peek() {
        match op {
            '+' | '-' => {
                c.next();
                let next = product(c, d);
                value += if op == '+' { next } else { -next };
            }
            _ => break,
        }
    }
    value
}

fn product(c: &mut std::iter::Peekable<impl Iterator<Item = char>>, d: DVec3) -> f64 {
    let mut value = factor(c, d);
    while c.next_if_eq(&'*').is_some() {
        value *= factor(c, d);
    }
    value
}

fn factor(c: &mut std::iter::Peekable<impl Iterator<Item = char>>, d: DVec3) -> f64 {
    match c.next() {
        Some('-') => -factor(c, d),
        Some('x') => d.x,
        Some('y') => d.y,
        Some('z') => d.z,
        Some('(') => {
            let value = sum(c, d);
            c.next();
            value
        }
        Some(digit) => {
            let mut text = String::from(digit);
            while let Some(next) = c.next_if(|n| n.is_ascii_digit() || *n == '.') {
                text.push(next);
            }
            text.parse().unwrap()
        }
        None => f64::NAN,
    }
}
