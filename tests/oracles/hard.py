#!/usr/bin/env python3
"""Makes `hard.npz`: hard inputs for the grid, its penalties and the losses under a mask of invalid pixels.

Like `make.py`, it computes everything in float64 from the formulas of METHOD, by central differences where a gradient is
needed, and shares no code with the program. It needs numpy. Run it in this folder: `python3 hard.py`.

Names are those of the method's reference files: `in.<case>.<array>`, `out.<case>.<array>`,
`out.<case>.grad.<term>.<array>`. `python3 hard.py FILE.npz...` compares the losses with reference files of the kinds
`loss_coarse` and `loss_fine` instead.
"""
import sys

import numpy as np

from make import BOX_MAX, BOX_MIN, FEATURES, PAIRS, gaussian_window

STEP = 1e-6  # of the central differences


def exact(values):
    """What the program reads: float32 numbers."""
    return np.asarray(values, np.float32).astype(np.float64)


def differences(function, inputs, name):
    """The gradients of several values with respect to a named array: `[values, *shape]`. Two step sizes must agree,
    since an input near a kink has no gradient to compare with."""
    columns = []
    for place in np.ndindex(*inputs[name].shape):
        slopes = []
        for step in (STEP, 3 * STEP):
            sides = []
            for sign in (1, -1):
                moved = dict(inputs)
                moved[name] = inputs[name].copy()
                moved[name][place] += sign * step
                sides.append(function(moved))
            slopes.append((sides[0] - sides[1]) / (2 * step))
        columns.append(slopes[0])
        off = np.abs(slopes[0] - slopes[1]).max()
        assert off < 1e-6 * max(1, np.abs(slopes[0]).max()), f"{name}{place} is near a kink: {off}"
    return np.stack(columns, 1).reshape(-1, *inputs[name].shape)


# --- The grid: values near 1, queries far outside ----------------------------------------------------------------

RESOLUTION, MULTIPLIERS = [4, 5, 3, 9], [1, 2]


def planes(rng, contrast):
    """Planes `[F, height, width]` around 1."""
    named = {}
    for scale, multiplier in enumerate(MULTIPLIERS):
        cells = [multiplier * r for r in RESOLUTION[:3]] + RESOLUTION[3:]
        for pair, (a, b) in enumerate(PAIRS):
            named[f"plane_s{scale}_p{pair}"] = exact(1 + contrast * rng.normal(size=(FEATURES, cells[b], cells[a])))
    return named


def store_grid(store, case):
    store[f"in.{case}.resolution"], store[f"in.{case}.multires"] = np.array(RESOLUTION), np.array(MULTIPLIERS)
    store[f"in.{case}.aabb"] = np.array([BOX_MAX, BOX_MIN], np.float32)


def regularisers_case(store):
    """Penalties of planes that differ from 1 by a thousandth: time planes start at 1."""
    case, values = "regularisers", planes(np.random.default_rng(11), 1e-3)
    weights = {"plane": 2e-4, "time": 1e-3, "l1": 1e-4}
    terms = dict.fromkeys(["plane_smooth", "time_smooth", "l1_time"], 0.0)
    gradients = {}
    for name, plane in values.items():
        store[f"in.{case}.{name}"] = plane.astype(np.float32)
        is_time = int(name[-1]) in (2, 4, 5)
        second = plane[:, 2:] - 2 * plane[:, 1:-1] + plane[:, :-2]
        gradient = np.zeros_like(plane)
        for rows, share in ((slice(2, None), 1), (slice(1, -1), -2), (slice(0, -2), 1)):
            gradient[:, rows] += share * 2 * second / second.size
        term = "time_smooth" if is_time else "plane_smooth"
        terms[term] += (second ** 2).mean()
        store[f"out.{case}.second_diff.{name}"] = (second ** 2).mean()
        gradients[term, name] = gradient
        if is_time:
            terms["l1_time"] += np.abs(1 - plane).mean()
            gradients["l1_time", name] = np.sign(plane - 1) / plane.size
    weight_of = {"plane_smooth": "plane", "time_smooth": "time", "l1_time": "l1"}
    for (term, name), gradient in gradients.items():
        store[f"out.{case}.grad.{term}.{name}"] = gradient.astype(np.float32)
        total = f"out.{case}.grad.total.{name}"
        store[total] = store.get(total, 0) + weights[weight_of[term]] * gradient
    for term, value in terms.items():
        store[f"out.{case}.{term}"] = value
    store[f"out.{case}.total"] = sum(weights[weight_of[term]] * value for term, value in terms.items())
    for name, weight in weights.items():
        store[f"in.{case}.w_{name}"] = weight
    store_grid(store, case)


def sample(plane, along, across):
    """A plane at one point, and its slopes along both grid coordinates: none on and beyond the border."""
    def place(coordinate, cells):
        cell = (coordinate + 1) / 2 * (cells - 1)
        inside = 0 < cell < cells - 1
        low = int(min(max(np.floor(cell), 0), cells - 2))
        return low, min(max(cell, 0), cells - 1) - low, inside * (cells - 1) / 2
    column, x, slope_x = place(along, plane.shape[2])
    row, y, slope_y = place(across, plane.shape[1])
    a, b = plane[:, row, column], plane[:, row, column + 1]
    c, d = plane[:, row + 1, column], plane[:, row + 1, column + 1]
    weights = {(row, column): (1 - x) * (1 - y), (row, column + 1): x * (1 - y), (row + 1, column): (1 - x) * y,
               (row + 1, column + 1): x * y}
    value = a + x * (b - a) + y * (c - a) + x * y * (d - c - b + a)
    return value, ((b - a) + y * (d - c - b + a)) * slope_x, ((c - a) + x * (d - c - b + a)) * slope_y, weights


def hexplane_case(store):
    """A field that differs from 1 by a ten-thousandth, and queries up to 1e30 outside the box."""
    case, rng = "hexplane", np.random.default_rng(12)
    values = planes(rng, 1e-4)
    points = exact(rng.uniform(BOX_MIN, BOX_MAX, (12, 3)))
    times = exact(rng.uniform(0, 1, (12, 1)))
    points[7], points[8, 1], points[9], points[10] = [1e6, -1e6, 0.5], -1e30, [-1e30, 1e30, 1e30], [3.0, -2.0, 9.0]
    times[8], times[9], times[10], times[11] = 40.0, -1e30, 1.5, 1.0
    cot = exact(1000 * rng.normal(size=(12, FEATURES * len(MULTIPLIERS))))
    slopes = 2 / (BOX_MIN - BOX_MAX)
    features, v_points, v_times = np.zeros(cot.shape), np.zeros(points.shape), np.zeros(times.shape)
    v_planes = {name: np.zeros_like(plane) for name, plane in values.items()}
    for i, (point, time) in enumerate(zip(points, times)):
        u = [*((point - BOX_MAX) * slopes - 1), time[0]]
        for scale in range(len(MULTIPLIERS)):
            part = slice(scale * FEATURES, (scale + 1) * FEATURES)
            samples = [sample(values[f"plane_s{scale}_p{p}"], u[a], u[b]) for p, (a, b) in enumerate(PAIRS)]
            features[i, part] = np.prod([value for value, *_ in samples], 0)
            for p, (a, b) in enumerate(PAIRS):
                others = cot[i, part] * np.prod([samples[q][0] for q in range(6) if q != p], 0)
                for axis, slope in ((a, samples[p][1]), (b, samples[p][2])):
                    if axis == 3:
                        v_times[i] += (others * slope).sum()
                    else:
                        v_points[i, axis] += (others * slope).sum() * slopes[axis]
                for (row, column), weight in samples[p][3].items():
                    v_planes[f"plane_s{scale}_p{p}"][:, row, column] += others * weight
    for name, plane in values.items():
        store[f"in.{case}.{name}"] = plane.astype(np.float32)
        store[f"out.{case}.grad.{name}"] = v_planes[name].astype(np.float32)
    for name, array in (("xyz", points), ("t", times), ("cot", cot)):
        store[f"in.{case}.{name}"] = array.astype(np.float32)
    store[f"out.{case}.feat"], store[f"out.{case}.grad.xyz"] = features, v_points
    store[f"out.{case}.grad.t"] = v_times
    store_grid(store, case)


# --- Losses under a mask of invalid pixels ------------------------------------------------------------------------

INPUTS = ["I_f", "I_b", "M", "D_f", "D_b", "scaling_f", "scaling_b"]


def blurred(images, size):
    def matrix(length):
        window, radius = gaussian_window(size, 1.5), size // 2
        return np.array([[window[j - i + radius] if abs(j - i) <= radius else 0 for j in range(length)]
                         for i in range(length)])
    return matrix(images.shape[2]) @ images @ matrix(images.shape[3]).T


def moments(a, b, size):
    ma, mb = blurred(a, size), blurred(b, size)
    return ma, mb, blurred(a * a, size) - ma ** 2, blurred(b * b, size) - mb ** 2, blurred(a * b, size) - ma * mb


def ssim_map(a, b):
    ma, mb, va, vb, vab = moments(a, b, 11)
    return (2 * ma * mb + 1e-4) * (2 * vab + 9e-4) / ((ma ** 2 + mb ** 2 + 1e-4) * (va + vb + 9e-4))


def structure_map(a, b):
    _, _, va, vb, vab = moments(a, b, 5)
    return np.clip((vab + 4.5e-4) / np.sqrt(va + vb + 4.5e-4), 0, 0.98)


def l1(a, b):
    return np.abs(a - b + 0 * (a + b)).mean()


def edge_variation(depth, photo):
    total = 0.0
    for axis in (3, 2):
        total += (np.abs(np.diff(depth, axis=axis))
                  * np.exp(-np.abs(np.diff(photo, axis=axis)).mean(1, keepdims=True))).mean()
    return total


def composed(v, stage):
    """METHOD §1.3; `safe` is the clamped mask of the first stage (§12, item 6)."""
    bright, static, dynamic = (v["M"][:, i:i + 1] for i in range(3))
    valid = v["V"]
    if stage == "fine":
        p_d, p_s = dynamic + 1e-6, static + 1e-6
    else:
        p_d, p_s = dynamic - 0.25, static + 0.25
    if stage == "safe":
        m_f = np.clip(p_d / np.maximum(p_d + p_s, 1e-3), 0, 1)
        m_b = 1 - m_f
    else:
        m_f, m_b = p_d / (p_d + p_s), p_s / (p_d + p_s)
    ell = 0.5 + np.where(bright <= 0.75, bright, 0.75 + (bright - 0.75) * 37)
    raw = v["I_b"] * valid
    i_f, i_b = np.clip(v["I_f"] * valid, 0, 1), np.clip(raw * ell, 0, 1)
    m_f, m_b = m_f * valid, m_b * valid
    return {"I": m_f * i_f + m_b * i_b, "I_f_clamped": i_f, "I_b_light": i_b, "brightness": ell, "M_f": m_f, "M_b": m_b,
            "I_b_raw": raw}


def terms(v, still, stage):
    """All terms, unweighted (METHOD §4.4). `still` are the inputs without gradient."""
    valid, ext, photo = v["V"], v["ext"], v["GT"] * v["V"]
    now, sg = composed(v, stage), composed(still, stage)
    i_f, i_b, m_f, m_b, ell = (now[key] for key in ("I_f_clamped", "I_b_light", "M_f", "M_b", "brightness"))
    t = {}
    if stage == "fine":
        t["main.l1"] = l1(now["I"], photo)
    else:
        t["main.coarse_mean"] = l1(0.5 * i_f + 0.5 * sg["I_b_light"], 0.9 * photo)
        t["main.coarse_mask"] = l1(m_f * i_f + m_b * sg["I_b_light"], 0.9 * photo)
        t["main.bg_l1"] = l1(i_b, photo)
        t["main.bg_dssim"] = 1 - ssim_map(i_b, photo).mean()
        t["main.fg_dssim"] = 1 - ssim_map(i_f, photo).mean()
    behind = lambda a, b, m: np.maximum((a - b) / ext * valid * m, 0).mean()
    t["main.depth_back"] = behind(v["D_f"], still["D_b"], sg["M_f"] > 0.6)
    t["main.depth_back_nodetach"] = behind(v["D_f"], v["D_b"], sg["M_f"] > 0.6)
    t["main.depth_forward"] = behind(still["D_b"], v["D_f"], sg["M_f"] < 0.4)
    t["main.depth_edge_tv"] = edge_variation(v["D_b"] / ext, photo)
    answers = {"fg": (sg["M_f"] > 0.51) * 1.0, "bg": (sg["M_b"] > 0.51) * 1.0}
    t["main.penalize_dynamic"] = (structure_map(i_f, sg["I_b_light"]) * valid * answers["fg"]).mean()
    for name, picture in (("fg", i_f), ("bg", i_b)):
        m = answers[name]
        t[f"main.{name}_comp_dssim"] = ((1 - ssim_map(picture, photo)) * m * valid).mean()
        t[f"main.{name}_comp_l1"] = l1(picture * m, photo * m)
    t["light.l_to_one"] = np.abs(ell * valid - valid).mean()
    t["light.explicit"] = l1(np.clip(sg["I_b_raw"] * ell, 0, 1), photo)
    t["light.dssim"] = 1 - ssim_map(now["I"], photo).mean()
    for name in ("fg", "bg"):
        scales = np.exp(v[f"scaling_{name[0]}"])
        t[f"light.large_{name}"] = np.maximum(scales.max(1) - 0.1 * ext, 0).mean()
        t[f"light.spiky_{name}"] = np.maximum(scales.max(1) / scales.min(1) - 5, 0).mean()
    if stage == "fine":
        t["light.entropy"] = -(m_f * np.log(m_f + 1e-6) + (1 - m_f) * np.log(1 - m_f + 1e-6)).mean()
    return t


# main weight, depth order, depth smoothness, likeness, brightness at the end, large and spiky, entropy, length of
# densification and of training, whether the first stage takes the mean (METHOD §11.1).
CONFIGS = {"neu3d": (1, 0.1, 0.01, 0.01, 0.5, 1, 0.01, 16000, 20000, True),
           "masked": (1, 0.1, 0.01, 0.01, 0.5, 1, 0.01, 16000, 20000, False),
           "onthego_indoor": (4, 0, 0.1, 0, 0.2, 0, 0.001, 26000, 30000, True)}


def weights(config, step, stage):
    main, order, smooth, likeness, end, shape, entropy, until, length, mean = CONFIGS[config]
    start = until // 10
    ramp = 0.001 + (end - 0.001) * (step - start) / (until - start)
    w = {"main.depth_back": order, "main.depth_forward": order, "main.depth_edge_tv": smooth,
         "main.penalize_dynamic": likeness, "light.dssim": 0.4,
         "light.explicit": 0.01 if step <= start else max(0.01 - ramp, 0),
         "light.l_to_one": 1e-4 + (ramp if stage == "fine" and step > start else 0)}
    for name in ("fg", "bg"):
        w[f"main.{name}_comp_dssim"], w[f"main.{name}_comp_l1"] = 0.4, 2
        w[f"light.large_{name}"], w[f"light.spiky_{name}"] = 0.01 * shape, 0.1 * shape * (step % 10 == 0)
    if stage == "fine":
        w["main.l1"], w["light.entropy"] = main, entropy * (step > length // 2)
    else:
        w["main.coarse_mean" if mean else "main.coarse_mask"] = main
        w["main.bg_l1"], w["main.bg_dssim"], w["main.fg_dssim"] = main, 0.2, 0.2
    return w


def values(v, still, stage, steps):
    """Terms and totals, by name."""
    found = terms(v, still, stage)
    named = {f"term.{name}": value for name, value in found.items()}
    for config, step in steps:
        for part in ("main", "light"):
            w = {name: value for name, value in weights(config, step, stage).items() if name.startswith(part)}
            named[f"total.{part}.{config}.it{step}"] = sum(w[name] * found[name] for name in w)
    return named


def loss_inputs(rng, shape):
    height, width = shape
    pictures = lambda: rng.uniform(0, 1, (2, 3, height, width))
    photo = pictures()
    near = lambda: np.clip(photo + 0.25 * rng.normal(size=photo.shape), -0.08, 1.1)
    mask = rng.uniform(0.02, 0.95, (2, 3, height, width))
    mask[:, 0] = rng.uniform(0.2, 0.8, (2, height, width))
    inputs = {"GT": photo, "I_f": near(), "I_b": near(), "M": mask, "D_f": rng.uniform(1, 4, (2, 1, height, width)),
              "D_b": rng.uniform(2, 4, (2, 1, height, width)), "scaling_f": rng.normal(-1.5, 1.2, (6, 3)),
              "scaling_b": rng.normal(-1.5, 1.2, (6, 3)),
              "V": (rng.uniform(size=(1, 1, height, width)) < 0.6) * 1.0}
    inputs = {name: exact(value) for name, value in inputs.items()}
    return {**inputs, "ext": 2.5}


def is_near_a_threshold(v, stage):
    """Whether an indicator or a clamp would be decided otherwise in single precision."""
    c = composed(v, stage)
    margins = [c[mask] - threshold for mask in ("M_f", "M_b") for threshold in (0.4, 0.51, 0.6)]
    margins += [v["M"][:, 0] - 0.75, c["I_b_raw"] * c["brightness"] - 1, v["I_f"], v["I_f"] - 1, v["I_b"]]
    if stage == "safe":
        margins += [v["M"][:, 2] - 0.25]
    return min(np.abs(m).min() for m in margins) < 3e-4


def loss_case(store, case, stage, steps):
    seed = next(s for s in range(1000) if not is_near_a_threshold(loss_inputs(np.random.default_rng(s), (5, 6)), stage))
    v = loss_inputs(np.random.default_rng(seed), (5, 6))
    if stage == "safe":
        # Nothing in front of these pixels, as far as single precision can tell.
        v["M"][0, 1:, 0] = exact(1e-7)
        v["M"][1, 1:, 4, 2:5] = exact([[4e-4, 1e-3, 0.0], [1e-4, 2e-4, 0.0]])
    for name in [*INPUTS, "GT", "V"]:
        store[f"in.{case}.{name}"] = v[name].astype(np.float32)
    store[f"in.{case}.ext"] = v["ext"]
    maps = composed(v, stage)
    photo = v["GT"] * v["V"]
    maps["ssim_map"], maps["structure_map"] = ssim_map(maps["I"], photo), structure_map(maps["I_f_clamped"], maps["I_b_light"])
    for name, array in maps.items():
        if name != "I_b_raw":
            store[f"out.{case}.map.{name}"] = array.astype(np.float32)
    named = values(v, v, stage, steps)
    for name, value in named.items():
        store[f"out.{case}.{name}"] = value
    function = lambda moved: np.array(list(values(moved, v, stage, steps).values()))
    for name in INPUTS:
        for key, gradient in zip(named, differences(function, v, name)):
            if np.abs(gradient).max() > 1e-9:
                store[f"out.{case}.grad.{key.removeprefix('term.')}.{name}"] = gradient.astype(np.float32)


def compare(path):
    """The largest differences of terms and totals from those of a reference file, and of a few gradients."""
    file = np.load(path)
    stage = "coarse" if "coarse" in path else "fine"
    v = {name[3:]: file[name].astype(np.float64) for name in file.files if name.startswith("in.") and "weight" not in name}
    steps = sorted({(n.split(".")[3], int(n.split(".")[4][2:])) for n in file.files if n.startswith("out.total.")})
    found = values(v, v, stage, steps)
    wanted = {name[4:]: float(file[name]) for name in file.files if name.startswith(("out.term.", "out.total."))}
    off = {name: abs(found[name] - value) / abs(value) for name, value in wanted.items() if value}
    print(path, len(off), "values, largest relative difference", max(off.values()), max(off, key=off.get))


if __name__ == "__main__":
    if len(sys.argv) > 1:
        for name in sys.argv[1:]:
            compare(name)
        sys.exit()
    arrays = {}
    regularisers_case(arrays)
    hexplane_case(arrays)
    loss_case(arrays, "loss_coarse", "coarse", [("neu3d", 500), ("masked", 500)])
    loss_case(arrays, "loss_safe", "safe", [("masked", 500)])
    loss_case(arrays, "loss_fine", "fine", [("neu3d", 1700), ("neu3d", 15010), ("onthego_indoor", 900)])
    np.savez_compressed("hard.npz", **arrays)
