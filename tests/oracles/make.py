#!/usr/bin/env python3
"""Makes `own.npz`, the small reference that stands in this repository, and `frame_1352x1014.png`.

Everything is computed here in float64 from the formulas of the method, by plain loops and by central differences, and
shares no code with the program. It needs numpy. Run it in this folder: `python3 make.py`.

Names: `in.<case>.<array>` are inputs (float32, used exactly), `out.<case>.<array>` results, `out.<case>.grad.<array>`
gradients of sum(result * in.<case>.cot). Results are stored in float32: they are read with tolerances of 1e-5.
"""
import struct
import zlib

import numpy as np

STEP = 1e-6  # of the central differences; all cases stay farther than this from any kink or threshold


def differences(function, inputs, name):
    """The gradient of a scalar function of named arrays with respect to one of them."""
    gradient = np.zeros(inputs[name].shape)
    for place in np.ndindex(*gradient.shape):
        sides = []
        for sign in (1, -1):
            moved = dict(inputs)
            moved[name] = inputs[name].copy()
            moved[name][place] += sign * STEP
            sides.append(function(moved))
        gradient[place] = (sides[0] - sides[1]) / (2 * STEP)
    return gradient


def rounded(values, parts=256):
    """Multiples of 1/256: exact in float32, and small in the file."""
    return np.round(np.asarray(values) * parts) / parts


def case(store, name, inputs, result, differentiated):
    """Stores a case: inputs, result and gradients."""
    exact = {key: rounded(value) for key, value in inputs.items()}
    output = result(exact)
    cot = rounded(np.random.default_rng(99).normal(size=output.shape), 8)
    loss = lambda values: float((result(values) * cot).sum())
    for key, value in exact.items():
        store[f"in.{name}.{key}"] = value.astype(np.float32)
    store[f"in.{name}.cot"] = cot.astype(np.float32)
    store[f"out.{name}.value"] = output.astype(np.float32)
    for key in differentiated:
        store[f"out.{name}.grad.{key}"] = differences(loss, exact, key).astype(np.float32)


# --- HexPlane and trunk -----------------------------------------------------------------------------------------

PAIRS = [(0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3)]
RESOLUTION = [3, 4, 3, 4]
MULTIPLIERS = [1, 2]
FEATURES = 2
BOX_MAX, BOX_MIN = np.array([1.0, 2.0, 1.5]), np.array([-1.0, 0.0, -0.5])


def bilinear(plane, along, across):
    """A plane [F, height, width] at grid coordinates in [-1, 1], corners on the outermost nodes, held at the border."""
    height, width = plane.shape[1:]
    column = np.clip((along + 1) / 2 * (width - 1), 0, width - 1)
    row = np.clip((across + 1) / 2 * (height - 1), 0, height - 1)
    left, top = min(int(column), width - 2), min(int(row), height - 2)
    x, y = column - left, row - top
    return ((1 - x) * (1 - y) * plane[:, top, left] + x * (1 - y) * plane[:, top, left + 1]
            + (1 - x) * y * plane[:, top + 1, left] + x * y * plane[:, top + 1, left + 1])


def hexplane(v):
    rows = []
    for point, time in zip(v["points"], v["times"]):
        u = (point - BOX_MAX) * 2 / (BOX_MIN - BOX_MAX) - 1
        u = [u[0], u[1], u[2], time[0]]
        features = []
        for scale in range(len(MULTIPLIERS)):
            product = np.ones(FEATURES)
            for pair, (a, b) in enumerate(PAIRS):
                product = product * bilinear(v[f"plane_s{scale}_p{pair}"], u[a], u[b])
            features.append(product)
        rows.append(v["weight"] @ np.concatenate(features) + v["bias"])
    return np.array(rows)


def hexplane_case(store):
    rng = np.random.default_rng(1)
    inputs = {"points": rng.uniform(BOX_MIN - 0.2, BOX_MAX + 0.2, (7, 3)), "times": rng.uniform(0, 1, (7, 1)),
              "weight": rng.normal(size=(3, 4)), "bias": rng.normal(size=3)}
    planes = []
    for scale, multiplier in enumerate(MULTIPLIERS):
        cells = [multiplier * r for r in RESOLUTION[:3]] + RESOLUTION[3:]
        for pair, (a, b) in enumerate(PAIRS):
            planes.append(f"plane_s{scale}_p{pair}")
            inputs[planes[-1]] = rng.uniform(0.3, 1.6, (FEATURES, cells[b], cells[a]))
    case(store, "hexplane", inputs, hexplane, ["points", "times", "weight", "bias"] + planes[:3] + planes[-3:])
    store["in.hexplane.aabb"] = np.array([BOX_MAX, BOX_MIN], np.float32)
    store["in.hexplane.resolution"] = np.array(RESOLUTION)
    store["in.hexplane.multires"] = np.array(MULTIPLIERS)


# --- SSIM -------------------------------------------------------------------------------------------------------

def gaussian_window(size, sigma):
    weights = np.exp(-((np.arange(size) - size // 2) ** 2) / (2 * sigma ** 2))
    return (weights / weights.sum()).astype(np.float32).astype(np.float64)


def blurred(image, window):
    radius = len(window) // 2
    padded = np.pad(image, radius)
    out = np.zeros(image.shape)
    for i, wy in enumerate(window):
        for j, wx in enumerate(window):
            out += wy * wx * padded[i:i + image.shape[0], j:j + image.shape[1]]
    return out


def ssim(v):
    window = gaussian_window(11, 1.5)
    c1, c2 = 0.01 ** 2, 0.03 ** 2
    maps = []
    for a, b in zip(v["a"][0], v["b"][0]):
        ma, mb = blurred(a, window), blurred(b, window)
        va, vb = blurred(a * a, window) - ma ** 2, blurred(b * b, window) - mb ** 2
        vab = blurred(a * b, window) - ma * mb
        maps.append((2 * ma * mb + c1) * (2 * vab + c2) / ((ma ** 2 + mb ** 2 + c1) * (va + vb + c2)))
    return np.array([maps])


def ssim_case(store):
    rng = np.random.default_rng(2)
    a = rng.uniform(0, 1, (1, 2, 9, 13))
    b = np.clip(a + rng.normal(size=a.shape) * 0.2, 0, 1)
    case(store, "ssim", {"a": a, "b": b}, ssim, ["a", "b"])


# --- Splatting --------------------------------------------------------------------------------------------------

WIDTH, HEIGHT, TILE = 20, 12, 16
FOCAL = np.array([19.0, 21.0])
NEAR, DILATION, ALPHA_MAX, ALPHA_MIN, STOP = 0.2, 0.3, 0.99, 1 / 255, 1e-4


def rotation_matrix(q):
    w, x, y, z = q / np.linalg.norm(q)
    return np.array([[1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
                     [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
                     [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)]])


CAMERA_TURN = rotation_matrix(np.array([0.97, 0.1, -0.15, 0.05]))
CAMERA_SHIFT = np.array([0.1, -0.05, 0.2])


def projected(v):
    """Centre in pixels (middle of the first pixel at 0), inverse covariance, radius, z, colour of each Gaussian."""
    rows = []
    eye = -CAMERA_TURN.T @ CAMERA_SHIFT
    tangent = np.array([WIDTH, HEIGHT]) / (2 * FOCAL)
    for i in range(len(v["means"])):
        mean = CAMERA_TURN @ v["means"][i] + CAMERA_SHIFT
        z = mean[2]
        assert z > NEAR
        # ((ndc + 1) size - 1) / 2 with the principal point in the middle; the original divides by z + 1e-7.
        centre = FOCAL * mean[:2] / (z + 1e-7) + np.array([WIDTH, HEIGHT]) / 2 - 0.5
        ratio = np.clip(mean[:2] / z, -1.3 * tangent, 1.3 * tangent)
        jacobian = np.array([[FOCAL[0] / z, 0, -FOCAL[0] * ratio[0] / z], [0, FOCAL[1] / z, -FOCAL[1] * ratio[1] / z]])
        axes = rotation_matrix(v["quaternions"][i]) * np.exp(v["log_scales"][i])
        covariance = axes @ axes.T
        view = jacobian @ CAMERA_TURN
        flat = view @ covariance @ view.T + DILATION * np.eye(2)
        middle = (flat[0, 0] + flat[1, 1]) / 2
        largest = middle + np.sqrt(max(0.1, middle ** 2 - np.linalg.det(flat)))
        direction = v["means"][i] - eye
        x, y, d = direction / np.linalg.norm(direction)
        basis = np.array([0.28209479177387814, -0.4886025119029199 * y, 0.4886025119029199 * d, -0.4886025119029199 * x])
        colour = np.maximum(0, basis @ v["sh"][i] + 0.5)
        rows.append((centre, np.linalg.inv(flat), np.ceil(3 * np.sqrt(largest)), z, colour))
    return rows


def splat(v, margins=None):
    """Colour, feature, alpha and depth, [3 + 1 + 2, H, W], by the rules of 3DGS, pixel by pixel."""
    rows = projected(v)
    opacity = 1 / (1 + np.exp(-v["opacity_logits"]))
    order = np.argsort([row[3] for row in rows], kind="stable")
    picture = np.zeros((6, HEIGHT, WIDTH))
    for py in range(HEIGHT):
        for px in range(WIDTH):
            light, total = 1.0, np.zeros(6)
            for i in order:
                centre, conic, radius, z, colour = rows[i]
                tile = np.array([px // TILE, py // TILE])
                # A tile takes part if it overlaps the square around the centre.
                first = np.floor((centre - radius) / TILE)
                end = np.floor((centre + radius + TILE - 1) / TILE)
                if (tile < first).any() or (tile >= end).any():
                    continue
                offset = centre - np.array([px, py])
                alpha = opacity[i] * np.exp(-0.5 * offset @ conic @ offset)
                if margins is not None:
                    margins += [abs(alpha / ALPHA_MIN - 1), abs(alpha / ALPHA_MAX - 1), abs(light * (1 - alpha) / STOP - 1)]
                alpha = min(ALPHA_MAX, alpha)
                if alpha < ALPHA_MIN:
                    continue
                if light * (1 - alpha) < STOP:
                    break
                total += alpha * light * np.concatenate([colour, v["features"][i], [1, z]])
                light *= 1 - alpha
            total[:4] += light * v["background"]
            picture[:, py, px] = total
    return picture


def splat_case(store):
    for seed in range(100):
        rng = np.random.default_rng(seed)
        count = 6
        depth = rng.uniform(2, 5, count)
        seen = np.stack([rng.uniform(-0.45, 0.45, count) * depth, rng.uniform(-0.25, 0.25, count) * depth, depth], 1)
        inputs = {"means": (seen - CAMERA_SHIFT) @ CAMERA_TURN, "quaternions": rng.normal(size=(count, 4)),
                  "log_scales": rng.uniform(-2.2, -0.6, (count, 3)), "opacity_logits": rng.uniform(-2, 2.5, count),
                  "sh": rng.normal(size=(count, 4, 3)) * 0.25, "features": rng.uniform(0, 1, (count, 1)),
                  "background": rng.uniform(0, 1, 4)}
        exact = {key: rounded(value) for key, value in inputs.items()}
        margins = []
        splat(exact, margins)
        if min(margins) > 1e-3 and min(row[4].min() for row in projected(exact)) > 0.01:
            break
    case(store, "splat", inputs, splat, list(inputs))
    store["in.splat.rotation"], store["in.splat.translation"] = CAMERA_TURN, CAMERA_SHIFT
    store["in.splat.focal"], store["in.splat.size"] = FOCAL, np.array([WIDTH, HEIGHT])


# --- A frame for the reader -------------------------------------------------------------------------------------

def black_png(path, width, height):
    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
    rows = (b"\0" + bytes((width + 7) // 8)) * height
    header = struct.pack(">IIBBBBB", width, height, 1, 0, 0, 0, 0)
    body = chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(rows, 9)) + chunk(b"IEND", b"")
    with open(path, "wb") as file:
        file.write(b"\x89PNG\r\n\x1a\n" + body)


if __name__ == "__main__":
    arrays = {}
    hexplane_case(arrays)
    ssim_case(arrays)
    splat_case(arrays)
    np.savez_compressed("own.npz", **arrays)
    black_png("frame_1352x1014.png", 1352, 1014)
