"""What the border between Python and the library costs.

python_overhead.py [RAYLIFT]: CPU times, medians, where nothing else is said. With the program RAYLIFT, its
own times of rendering stand beside those of Python.
"""

import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

import raylift
from raylift import _core

DEMO = Path(__file__).resolve().parents[2] / "assets/demo"
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


if __name__ == "__main__":
    measure_estimate()
    measure_render(sys.argv[1] if len(sys.argv) > 1 else None)
