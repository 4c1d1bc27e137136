"""What the border between Python and the library costs, and peers beside it.

python_overhead.py [RAYLIFT]: CPU times, medians, where nothing else is said; peers (poselib, trimesh with embreex, open3d) are
measured where they are installed. With the program RAYLIFT, its own times of rendering stand beside
those of Python.
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
    made, empty = _core.PoseProblem(CAMERA, pixels, points), _core.PoseProblem(CAMERA)
    whole = median_us(lambda: raylift.estimate_pose(CAMERA, pixels, points, **options), 2000)
    alone = median_us(lambda: _core.estimate(made, **options), 2000)
    call = median_us(lambda: _core.estimate(empty, **options), 2000)
    row("estimate_pose, 1000 matches: arrays to the library", f"{whole - alone:.1f} us")
    row("  the call itself (no matches: less than its share)", f"{call:.1f} us")


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


def error_deg(pose, truth):
    cosine = (np.trace(pose.rotation @ truth.rotation.T) - 1) / 2
    return np.degrees(np.arccos(np.clip(cosine, -1, 1)))


def measure_poselib():
    try:
        import poselib
    except ImportError:
        print("poselib is not installed")
        return
    rng = np.random.default_rng(0)
    problems = [problem(rng, 1000) for _ in range(30)]
    camera = {"model": "PINHOLE", "width": 640, "height": 480, "params": [500, 500, 320, 240]}
    peers = {
        "raylift p3p": lambda x, p: raylift.estimate_pose(CAMERA, x, p, method="p3p").cam_from_world,
        "raylift p3p, paper": lambda x, p: raylift.estimate_pose(
            CAMERA, x, p, method="p3p", refinement="paper").cam_from_world,
        "poselib absolute": lambda x, p: raylift.Rigid3.of(poselib.estimate_absolute_pose(
            x, p, camera, {"max_reproj_error": 8.0}, {})[0]),
    }
    row("absolute pose, 1000 matches, 40 % wrong", "CPU", "error")
    for name, estimate in peers.items():
        times, errors = [], []
        for truth, pixels, points in problems:
            start = time.process_time_ns()
            pose = estimate(pixels, points)
            times.append(time.process_time_ns() - start)
            errors.append(error_deg(pose, truth))
        row(f"  {name}", f"{np.median(times) / 1e6:.2f} ms", f"{np.median(errors):.4f} deg")


def measure_rays():
    mesh = raylift.Mesh.read(DEMO / "scene.obj")
    image = raylift.ColmapModel.read(DEMO / "model").posed_images[0]
    rays = image.cam_from_world.inverse().rotation @ image.camera.rays(
        np.random.default_rng(0).uniform(0, 480, (100000, 2))).T
    directions = np.ascontiguousarray(rays.T)
    origins = np.tile(image.cam_from_world.center, (len(directions), 1))
    row("100,000 rays", "CPU")
    caster = raylift.RayCaster(mesh)
    row("  raylift cast", f"{median_us(lambda: caster.cast(origins, directions, threads=1), 20) / 1e3:.1f} ms")
    try:
        import trimesh
        from trimesh.ray.ray_pyembree import RayMeshIntersector

        peer = RayMeshIntersector(trimesh.Trimesh(mesh.vertices, mesh.triangles, process=False))
        cpu = median_us(lambda: peer.intersects_location(origins, directions, multiple_hits=False), 20)
        row("  trimesh with embreex", f"{cpu / 1e3:.1f} ms")
    except ImportError:
        print("trimesh with embreex is not installed")
    try:
        import open3d

        scene = open3d.t.geometry.RaycastingScene(1)
        scene.add_triangles(mesh.vertices.astype(np.float32), mesh.triangles)
        both = np.hstack([origins, directions]).astype(np.float32)
        row("  open3d", f"{median_us(lambda: scene.cast_rays(open3d.core.Tensor(both)), 20) / 1e3:.1f} ms")
    except ImportError:
        print("open3d is not installed")


if __name__ == "__main__":
    measure_estimate()
    measure_render(sys.argv[1] if len(sys.argv) > 1 else None)
    measure_poselib()
    measure_rays()
