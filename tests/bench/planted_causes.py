"""What `raylift compare` names of causes of wrong depth that are planted here, as a table in Markdown.

planted_causes.py SEED MODEL MESH [MODEL MESH]... [--only CAUSE,...]: each cause at three sizes drawn by SEED, in
the scene of each model and mesh, by some 12 of its images. A cause is named rightly if the first finding has its
name and its size, and wrongly if that has any other name or size than "not explained".
"""

import argparse
import re
import tempfile
from pathlib import Path

import numpy as np

import raylift

IMAGES = 12


class Camera:
    """An image with the true depth of its pixels, and depth along other rays."""

    def __init__(self, caster, images, index):
        self.caster, self.images, self.index = caster, images, index
        self.image = images[index]
        self.camera = self.image.camera
        y, x = np.mgrid[0:self.camera.height, 0:self.camera.width] + 0.5
        self.pixels = np.column_stack([x.ravel(), y.ravel()])
        self.center = self.camera.matrix[:2, 2]
        self.depth = self.seen(self.rays(self.pixels))

    def rays(self, pixels):
        rays = self.camera.rays(pixels)
        return rays / rays[:, 2:]

    def seen(self, rays, turn=np.eye(3), pose=None):
        """z along rays with z = 1, 0 where there is nothing; turn: of the image's camera from the map's."""
        pose = pose or self.image.cam_from_world
        hits = self.caster.cast(pose.center[None], rays @ turn.T @ pose.rotation)
        return np.nan_to_num(hits["ray_t"]).reshape(self.camera.height, self.camera.width)

    def moved(self, motion):
        """e(p) = t(motion(p))."""
        return self.seen(self.rays(motion(self.pixels)))


def rotation(vector_deg):
    angle = np.radians(np.linalg.norm(vector_deg))
    x, y, z = np.asarray(vector_deg) / np.linalg.norm(vector_deg)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross


def where_known(z, function):
    return np.where(z > 0, function(np.maximum(z, 1e-6)), 0)


def windows(z, side, outside):
    padded = np.pad(np.where(z > 0, z, outside), side // 2, mode="edge")
    return np.lib.stride_tricks.sliding_window_view(padded, (side, side))


def extreme(z, side, function, outside):
    """Of the known depths of a square, row by row: windows are large."""
    rows = function(np.lib.stride_tricks.sliding_window_view(
        np.pad(np.where(z > 0, z, outside), side // 2, mode="edge"), side, axis=0), axis=-1)
    return function(np.lib.stride_tricks.sliding_window_view(rows, side, axis=1), axis=-1)


def blurred(z, sigma):
    reach = int(np.ceil(3 * sigma))
    weights = np.exp(-0.5 * (np.arange(-reach, reach + 1) / sigma) ** 2)

    def along_both(values):
        for axis in (0, 1):
            values = np.apply_along_axis(np.convolve, axis, values, weights, "same")
        return values

    return where_known(z, lambda known: along_both(z) / np.maximum(along_both((z > 0).astype(float)), 1e-9))


def median(z, side):
    values = windows(z, side, np.nan)[z > 0].reshape(-1, side * side)
    result = np.zeros_like(z)
    result[z > 0] = np.nanmedian(values, axis=-1)
    return result


def fattened(z, reach):
    nearest = extreme(z, 2 * reach + 1, np.min, np.inf)
    return np.where((z > 0) & (nearest < 0.9 * z), nearest, z)


def smooth_field(rng, shape):
    """Cosines of up to two periods along each axis, of deviation 1."""
    v, u = np.mgrid[0:1:shape[0] * 1j, 0:1:shape[1] * 1j]
    field = sum(rng.normal() * np.cos(np.pi * (i * u + rng.uniform())) * np.cos(np.pi * (j * v + rng.uniform()))
                for i in range(4) for j in range(4) if i + j > 0)
    return (field - field.mean()) / field.std()


class Planted:
    """A cause at one size: depth(camera, rng) is the map, `names` what may be said, `size` of it."""

    def __init__(self, depth, names, size=(), keys="", tolerance=0.1, floor=0.0, curve=None):
        self.depth, self.names, self.size, self.keys = depth, names.split("|"), size, keys
        self.tolerance, self.floor, self.curve = tolerance, floor, curve

    def has(self, size):
        """True if `size` is that planted: within a share of its length, or by a little."""
        if self.curve:  # depths and errors there, in turn
            at, errors = np.array(size[0::2]), np.array(size[1::2])
            return np.allclose(errors, self.curve(at), rtol=self.tolerance, atol=0.003)
        planted = np.array(self.size() if callable(self.size) else self.size, float)
        if len(planted) == 0:
            return True
        size = np.array(size[:len(planted)], float)
        allowed = max(self.tolerance * np.linalg.norm(planted), self.floor)
        return len(size) == len(planted) and np.linalg.norm(size - planted) <= allowed


class Measured:
    """What was planted of a random cause, over the images."""

    def __init__(self, summary):
        self.values, self.summary = [], summary

    def add(self, value):
        self.values.append(value)

    def __call__(self):
        return [self.summary(self.values)]


def robust_sigma(values):
    return 1.4826 * np.median(np.abs(values - np.median(values)))


def sign(rng):
    return rng.choice([-1, 1])


def direction(rng, dimensions):
    vector = rng.normal(size=dimensions)
    return vector / np.linalg.norm(vector)


def shift(by):
    return Planted(lambda c, rng: c.moved(lambda p: p - by), "shift", by, floor=0.1)


def late(frames):
    def depth(c, rng):
        other = c.images[np.clip(c.index + frames, 0, len(c.images) - 1)]
        return c.seen(c.rays(c.pixels), pose=other.cam_from_world)

    return Planted(depth, "time offset", [frames])


def lens(k):
    def motion(c, p):
        radii = np.sum(((p - c.center) / c.camera.matrix[0, 0]) ** 2, axis=1)
        return c.center + (p - c.center) * (1 + k * radii[:, None])

    return Planted(lambda c, rng: c.moved(lambda p: motion(c, p)), "lens", [k], floor=0.005)


def turned(degrees):
    """By a camera that stands turned: z is along its own axis."""
    return Planted(lambda c, rng: c.seen(c.rays(c.pixels), rotation(degrees)), "rotation", degrees, floor=0.05)


def causes(rng, near, middle, far):
    """Name: three Planted. near, middle, far: 1 %, 50 % and 99 % of the scene's depths."""
    def thrice(make):
        return [make() for _ in range(3)]

    def value(function, names, size, **more):
        return Planted(lambda c, rng: where_known(c.depth, function), names, size, **more)

    def scale():
        factor = 1 + sign(rng) * rng.uniform(0.03, 0.15)
        return value(lambda z: factor * z, "scale", [np.log(factor)])

    def offset():
        b = sign(rng) * rng.uniform(0.03, 0.15) * min(middle, 5 * near)
        return value(lambda z: z + b, "offset", [b])

    def zoom():
        factor = 1 + sign(rng) * rng.uniform(0.015, 0.1)
        return Planted(lambda c, rng: c.moved(lambda p: c.center + (p - c.center) / factor), "zoom", [factor],
                       tolerance=0, floor=0.1 * abs(factor - 1))

    def blur():
        sigma = rng.uniform(1.5, 6)
        return Planted(lambda c, rng: blurred(c.depth, sigma), "smoothing", [sigma])

    def bits(count):
        def depth(c, rng):
            step = c.depth.max() / (2 ** count - 1)
            return step * np.round(c.depth / step)

        return Planted(depth, "quantization", [count], floor=0.2)

    def noise():
        sigma = rng.uniform(0.012, 0.05)
        return Planted(lambda c, rng: c.depth * (1 + sigma * rng.normal(size=c.depth.shape)),
                       "noise|multiplicative noise", [sigma])

    def additive_noise():
        sigma = rng.uniform(0.012, 0.05) * middle
        return Planted(lambda c, rng: where_known(c.depth, lambda z: np.maximum(
            z + sigma * rng.normal(size=z.shape), 0)), "noise|additive noise", [sigma])

    def clamp():
        limit = rng.uniform(0.5, 0.85) * far
        return value(lambda z: np.minimum(z, limit), "clamp", [limit], tolerance=0.01)

    def holes():
        share = rng.uniform(0.08, 0.3)

        measured = Measured(np.mean)

        def depth(c, rng):
            field = smooth_field(rng, c.depth.shape)
            z = np.where(field < np.quantile(field, share), 0, c.depth)
            measured.add(100 * np.mean(z[c.depth > 0] == 0))
            return z

        return Planted(depth, "holes", measured)

    def warp():
        sigma = rng.uniform(0.025, 0.08)
        return Planted(lambda c, rng: c.depth * np.exp(sigma * smooth_field(rng, c.depth.shape)), "warp", [sigma],
                       tolerance=0.25)

    def bubbles():
        count, height = rng.integers(2, 7), rng.uniform(0.12, 0.35)
        measured = Measured(np.mean)

        def depth(c, rng):
            z = c.depth.copy()
            y, x = np.mgrid[0:z.shape[0], 0:z.shape[1]] / z.shape[1]
            for _ in range(count):
                radius = rng.uniform(0.06, 0.14)
                squared = ((x - rng.uniform(0, 1)) ** 2 + (y - rng.uniform(0, 0.75)) ** 2) / radius ** 2
                z *= 1 - height * np.maximum(1 - squared, 0) ** 2
            measured.add(100 * np.mean(z[c.depth > 0] < 0.95 * c.depth[c.depth > 0]))
            return z

        return Planted(depth, "bubbles", measured, tolerance=0.3)

    def scale_per_image():
        sigma = rng.uniform(0.03, 0.12)
        measured = Measured(robust_sigma)

        def depth(c, rng):
            measured.add(sigma * rng.normal())
            return c.depth * np.exp(measured.values[-1])

        return Planted(depth, "per-image scale", measured)

    def inverse_offset():
        a = rng.uniform(100, 400)
        b = sign(rng) * rng.uniform(0.1, 0.5) * a / far
        return value(lambda z: np.maximum(a / z + b, 0), "inverse offset", [a, b], keys=",kind=inverse",
                     tolerance=0.02)

    def flying():
        share = rng.uniform(0.3, 0.9)
        measured = Measured(np.mean)

        def depth(c, rng):
            near = extreme(c.depth, 3, np.min, np.inf)
            far = extreme(c.depth, 3, np.max, 0)
            jumps = (c.depth > 0) & (far > 1.094 * near)  # where 3 % off both can be told
            flies = jumps & (rng.random(near.shape) < share)
            near[~flies] = 0
            z = np.where(flies, near + rng.random(near.shape) * (far - near), c.depth)
            between = flies & (z > 1.03 * near) & (z < far / 1.03) & (np.abs(np.log(
                np.maximum(z, 1e-6) / np.maximum(c.depth, 1e-6))) > 0.03)
            measured.add(100 * between.sum() / max(jumps.sum(), 1))
            return z

        return Planted(depth, "flying pixels", measured, tolerance=0.25)

    def drift():
        share = sign(rng) * rng.uniform(0.04, 0.15)
        return value(lambda z: z * (1 + share * z / middle), "depth curve", [share / middle],
                     curve=lambda z: share * z / middle)

    def power_law():
        p, a = 1 + sign(rng) * rng.uniform(0.08, 0.3), rng.uniform(0.7, 1.3)
        return value(lambda z: a * z ** p, "power law", [p, a], tolerance=0.02)

    def disparity():
        a = rng.uniform(50, 400)
        return value(lambda z: a / z, "disparity", [a])

    def flipped(*axes):
        return Planted(lambda c, rng: np.flip(c.depth, axes), "flipped", [1 in axes, 0 in axes])

    def ray(c):
        return np.linalg.norm(c.rays(c.pixels), axis=1).reshape(c.depth.shape)

    halves = rng.permutation([(0.5, 0.5), (-0.5, -0.5), (0.5, -0.5), (-0.5, 0.5), (0.5, 0), (0, -0.5)])[:3]
    return {
        "exact": [Planted(lambda c, rng: c.depth, "")],
        "scale": thrice(scale),
        "offset": thrice(offset),
        "shift": thrice(lambda: shift(rng.uniform(1.5, 8) * direction(rng, 2))),
        "half a pixel": [shift(by) for by in halves],
        "rotation": thrice(lambda: turned(rng.uniform(0.5, 3) * direction(rng, 3))),
        "zoom": thrice(zoom),
        "frames late": [late(frames) for frames in rng.permutation([-2, -1, 1, 2])[:3]],
        "blur": thrice(blur),
        "bits": [bits(count) for count in rng.permutation([5, 6, 7, 8])[:3]],
        "lens": thrice(lambda: lens(sign(rng) * rng.uniform(0.05, 0.2))),
        "noise": thrice(noise),
        "additive noise": thrice(additive_noise),
        "clamp": thrice(clamp),
        "holes": thrice(holes),
        "warp": thrice(warp),
        "bubbles": thrice(bubbles),
        "scale per image": thrice(scale_per_image),
        "principal point off": thrice(lambda: shift(np.array([sign(rng) * rng.uniform(3, 12), 0]))),
        "flipped": [flipped(0), flipped(1), flipped(0, 1)],
        "ray length as z": [Planted(lambda c, rng: c.depth * ray(c), "ray length", [1])],
        "z as ray length": [Planted(lambda c, rng: c.depth, "ray length", [-1], keys=",kind=ray")],
        "disparity as z": thrice(disparity),
        "inverse with offset": thrice(inverse_offset),
        "flying pixels": thrice(flying),
        "drift with depth": thrice(drift),
        "power law": thrice(power_law),
        "median": [Planted(lambda c, rng, side=side: median(c.depth, side), "median", [side])
                   for side in rng.permutation([3, 5, 7, 9])[:3]],
        "fattened foreground": [Planted(lambda c, rng, reach=reach: fattened(c.depth, reach), "fattened foreground",
                                        [reach]) for reach in rng.permutation([2, 3, 4, 5, 6])[:3]],
    }


def compare(folder, cameras, planted, model, mesh, every, rng):
    geometry = {"truth": f"mesh:{mesh}"}
    for k, one in enumerate(planted):
        for camera in cameras:
            file = (folder / str(k) / camera.image.name).with_suffix(".npy")
            file.parent.mkdir(parents=True, exist_ok=True)
            np.save(file, np.asarray(one.depth(camera, rng), np.float32))
        geometry[f"planted {k}"] = f"depth:{folder / str(k)}{one.keys}"
    result = raylift.compare(model, geometry, truth="truth", every=every, max_side=320)
    return result["depth"]["sources"][1:]


def size_of(source):
    finding = source["findings"][0]
    explanation = source["explanation"]
    if finding["distortion"] == "quantization" and explanation["cause"] == "quantization":
        return explanation["size"][1:]  # bits
    if explanation and explanation["cause"] == finding["distortion"] and explanation["size"]:
        return explanation["size"]
    if finding["distortion"] == "additive noise":
        return [float(re.search(r"\d[\d.e+-]*", finding["text"])[0])]
    return [finding["amount"]]


def judge(planted, source):
    if not source["findings"]:
        return "right" if planted.names == [""] else "not explained"
    name = source["findings"][0]["distortion"]
    if name == "not explained":
        return name
    return "right" if name in planted.names and planted.has(size_of(source)) else "WRONG"


def numbers(size):
    return ", ".join(f"{value:.3g}" for value in (size() if callable(size) else size))


def tell_scene(seed, model, mesh, only):
    references = raylift.Scene(model).references
    every = max(1, len(references) // IMAGES)
    images = sorted(raylift.Scene(model, every=every).references, key=lambda image: image.name)
    caster = raylift.RayCaster(raylift.Mesh.read(mesh))
    cameras = [Camera(caster, images, i) for i in range(len(images))]
    known = np.concatenate([camera.depth[camera.depth > 0] for camera in cameras])
    rng = np.random.default_rng(seed)
    print(f"\n## {mesh}: {len(images)} images, seed {seed}\n\n| planted | size | named | |\n|---|---|---|---|")
    counts = dict.fromkeys(["right", "not explained", "WRONG"], 0)
    for cause, planted in causes(rng, *np.quantile(known, [0.01, 0.5, 0.99])).items():
        if only and cause not in only:
            continue
        with tempfile.TemporaryDirectory() as folder:
            for one, source in zip(planted, compare(Path(folder), cameras, planted, model, mesh, every, rng)):
                verdict = judge(one, source)
                counts[verdict] += 1
                said = "; ".join(finding["text"] for finding in source["findings"])
                print(f"| {cause} | {numbers(one.size)} | {said} | {verdict} |", flush=True)
    total = sum(counts.values())
    print(f"\nOf {total}: " + ", ".join(f"{count} {verdict} ({100 * count / total:.0f} %)"
                                       for verdict, count in counts.items()), flush=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("seed", type=int)
    parser.add_argument("scenes", nargs="+", metavar="MODEL MESH")
    parser.add_argument("--only", default="", help="causes, separated by commas")
    arguments = parser.parse_args()
    scenes = iter(arguments.scenes)
    for model, mesh in zip(scenes, scenes):
        tell_scene(arguments.seed, model, mesh, [name for name in arguments.only.split(",") if name])


if __name__ == "__main__":
    main()
