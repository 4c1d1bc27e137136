"""What the border between Python and the library costs.

python_overhead.py [RAYLIFT]: CPU times, medians, where nothing else is said. With the program RAYLIFT, its
own times of rendering stand beside those of Python. With OpenCV, h5py, pytest and onnxruntime, extractors
and matchers of one's own stand beside the built-in ones.
"""

import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

import raylift
from raylift import _core, _matching

ROOT = Path(__file__).resolve().parents[2]
DEMO = ROOT / "assets/demo"
CAMERA = raylift.Camera("PINHOLE", 640, 480, [500, 500, 320, 240])


def median_us(call, repeat=200):
    times = []
    for _ in range(repeat):
        start = time.process_time_ns()
        call()
        times.append(time.process_time_ns() - start)
    return np.median(times) / 1e3


def least_ms(call, repeat=200):
    times = []
    for _ in range(repeat):
        start = time.perf_counter_ns()
        call()
        times.append(time.perf_counter_ns() - start)
    return min(times) / 1e6


def row(what, *values):
    print(f"{what:58}" + "".join(f"{value:>16}" for value in values))


def problem(rng, count, wrong=0.4):
    truth = raylift.Rigid3([0.99, 0.1, 0.05, -0.02], [0.1, -0.2, 0.3])
    points = rng.uniform([-2, -2, 4], [2, 2, 8], (count, 3))
    pixels = CAMERA.project(truth.transform(points)) + rng.normal(0, 0.5, (count, 2))
    pixels[: int(wrong * count)] = rng.uniform(0, 480, (int(wrong * count), 2))
    return truth, pixels, points


def measure_estimate():
    _, pixels, points = problem(np.random.default_rng(0), 1000)
    options = dict(method="p3p", refinement="paper", min_iterations=1, max_iterations=1)
    # Not as a difference of whole calls, which vary by more than that.
    arrays = median_us(lambda: _core.PoseProblem(CAMERA, pixels, points), 2000)
    call = median_us(lambda: raylift.estimate_pose(CAMERA, **options), 2000)
    row("estimate_pose, 1000 matches: arrays to the library's matches", f"{arrays:.1f} us")
    row("  all else but the estimate (a call without matches)", f"{call:.1f} us")


def measure_render(program):
    caster = raylift.RayCaster(raylift.Mesh.read(DEMO / "scene.obj"))
    image = raylift.ColmapModel.read(DEMO / "model").posed_images[0]
    times = [least_ms(lambda p=product: caster.render(image.camera, image.cam_from_world, [p], threads=1))
             for product in ("depth", "color")]
    row("render, 640 x 480, least time that elapsed", "depth", "color")
    row("  Python", *(f"{t:.2f} ms" for t in times))
    if program is None:
        return
    of_program = []
    for product in ("depth", "color"):
        with tempfile.TemporaryDirectory() as folder:
            views = Path(folder) / "views.txt"
            q, t = image.cam_from_world.qvec, image.cam_from_world.tvec
            views.write_text("".join(f"{i}.jpg {' '.join(map(repr, map(float, [*q, *t])))} {image.camera}\n"
                                     for i in range(200)))
            lines = subprocess.run(
                [program, "render", "--geometry", f"mesh:{DEMO / 'scene.obj'}", "--cameras", views, "--out",
                 Path(folder) / "out", "--products", product, "--threads", "1", "--log-json"],
                check=True, text=True, capture_output=True).stdout.splitlines()
            of_program.append(min(json.loads(line)["render_ms"] for line in lines))
    row("  the program", *(f"{t:.2f} ms" for t in of_program))
    row("  ratio", *(f"{t / p:.3f}" for t, p in zip(times, of_program)))


def measure_localize(what, **options):
    """Of the demo's queries, once what is to be known of the scene is."""
    scene = raylift.Scene(DEMO / "model", [f"mesh:{DEMO / 'scene.obj'}"], images=DEMO / "images")
    truth = {image.name: image.cam_from_world for image in raylift.ColmapModel.read(DEMO / "ground_truth").posed_images}
    queries = raylift.read_queries(DEMO / "queries.txt")
    localizer = raylift.Localizer(scene, **options)
    localizer.localize_all(queries, threads=1)
    elapsed, cpu = time.perf_counter(), time.process_time()
    found = localizer.localize_all(queries, threads=1)
    elapsed, cpu = time.perf_counter() - elapsed, time.process_time() - cpu
    near = sum(bool(one) and np.linalg.norm(one.cam_from_world.center - truth[name].center) < 0.1
               for name, one in found.items())
    row("  " + what, f"{len(queries) / elapsed:.2f}", f"{cpu / len(queries) * 1e3:.1f} ms", f"{near} of {len(queries)}")


def brief(image):
    return image[::40, ::40].tobytes()


def measure_matchers():
    try:
        import cv2
        import onnxruntime  # noqa: F401
        os.environ.setdefault("RAYLIFT_SOURCE", str(ROOT))
        sys.path.insert(0, str(ROOT / "tests/python"))
        from test_matching import sift_pixels
        from test_onnx import upright_sift
    except ImportError as error:
        print(f"matchers of one's own are left out: {error}")
        return
    row("localize_all, one thread", "queries/s", "CPU per query", "within 0.1")
    sift, orb = cv2.SIFT_create(1000), cv2.ORB_create(3000)
    kept = {}

    def keeping(first, second):
        rows = kept[brief(first), brief(second)] = sift_pixels(first, second)
        return rows

    with tempfile.TemporaryDirectory() as folder:
        made = raylift.onnx.Extractor(upright_sift(Path(folder) / "made.onnx", 480, 640), threads=1)
        measure_localize("built in, 1000 features", max_features=1000)
        measure_localize("OpenCV's SIFT, 1000 features", extractor=sift)
        measure_localize("  matched by cv2.BFMatcher", extractor=sift, matcher=cv2.BFMatcher())
        measure_localize("OpenCV's ORB, 3000 features, matched by cv2.BFMatcher", extractor=orb,
                         matcher=cv2.BFMatcher(cv2.NORM_HAMMING))
        measure_localize("an extractor in ONNX, 1500 features", extractor=made)
        measure_localize("a function of two photographs (SIFT, BFMatcher)", matcher=keeping, max_features=1000)
        measure_localize("  that returns the same at once", max_features=1000,
                         matcher=lambda first, second: kept[brief(first), brief(second)])
        measure_localize("  that returns nothing: retrieval alone", max_features=1000, matcher=lambda *_: None)
        write_matches(kept, Path(folder))
        measure_localize("  the same matches from files", matches=folder)
    rows, file = np.ones((500, 4)), str(next((DEMO / "images").rglob("*.jpg")))
    match = _matching.matcher_of(lambda *_: rows, lambda image: {"keypoints": rows[:, :2]})
    pair_us = median_us(lambda: match(("", ""), [("", file)] * 10, np.zeros((4, 4, 3), np.uint8))) / 10
    row("a matcher of features that returns 500 matches at once", f"{1e6 / pair_us:.0f}/s",
        f"{pair_us:.1f} us per pair")


def write_matches(kept, folder):
    """Matches in files as Localizer(matches=folder) reads them."""
    names = {brief(raylift.read_image(file)): str(file.relative_to(DEMO / "images"))
             for file in (DEMO / "images").rglob("*.jpg")}
    with open(folder / "pairs.txt", "w", encoding="utf-8") as pairs:
        for i, ((first, second), rows) in enumerate(kept.items()):
            np.savez(folder / f"{i}.npz", mkpts0=rows[:, :2], mkpts1=rows[:, 2:])
            pairs.write(f"{names[first]} {names[second]} {i}.npz\n")


if __name__ == "__main__":
    measure_estimate()
    measure_matchers()
    measure_render(sys.argv[1] if len(sys.argv) > 1 else None)
