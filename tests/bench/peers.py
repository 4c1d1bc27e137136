"""Raylift beside what PyPI has for the same work: the same inputs in one process, CPU times and errors.

peers.py [FOLDER...]: poses of PoseLib's and pycolmap's estimators, on problems made here or on those in each
FOLDER (files of the format pose-problem), one at a time and in batches; rays of Open3D and of trimesh with
embreex; depth images of pyrender. A peer that is not installed, or does not start, is left out with a message.
Times are medians of one call; a ratio above 1 is slower than Raylift's row, the first.
"""

import importlib
import importlib.metadata
import json
import os
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np

import raylift

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tests/python"))
from synthetic import CAMERA, Problem, angle_deg  # noqa: E402

THRESHOLDS_PX = {"max_reproj_error": 8.0, "max_epipolar_error": 2.0}  # Raylift's defaults


def peer(name):
    try:
        return importlib.import_module(name)
    except Exception as error:  # some fail in ways of their own
        print(f"  {name} is left out: {str(error).splitlines()[0]}")
        return None


def print_versions():
    for name in ("raylift", "numpy", "poselib", "pycolmap", "open3d", "trimesh", "embreex", "pyrender"):
        try:
            print(f"  {name} {importlib.metadata.version(name)}")
        except importlib.metadata.PackageNotFoundError:
            if name == "raylift":
                print(f"  raylift {raylift.__version__}")


def cpu_ms(call):
    start = time.process_time_ns()
    result = call()
    return (time.process_time_ns() - start) / 1e6, result


def print_table(title, columns, rows):
    """rows: name, CPU time in ms, further columns."""
    print(f"\n{title}")
    print(f"  {'':28}" + "".join(f"{column:>18}" for column in ["CPU", "ratio", *columns]))
    for name, cpu, *rest in rows:
        print(f"  {name:28}{cpu:15.2f} ms{cpu / rows[0][1]:18.2f}" + "".join(f"{value:>18}" for value in rest))


# --- poses ---


def made_problems():
    """0.5 pixels of noise, 40 % wrong, three references."""
    for seed in range(20):
        made = Problem(seed, points=500, wrong=200)
        yield made.truth, raylift.PoseProblem(CAMERA, made.points2d, made.points3d, name=str(seed), **made.pairs)


def problems_in(folder):
    for file in sorted(Path(folder).glob("*.json")):
        truth = json.loads(file.read_text(encoding="utf-8"))["query"].get("gt_cam_from_world")
        if truth:
            yield raylift.Rigid3(truth["qvec"], truth["tvec"]), raylift.PoseProblem.read(file)


def arrays_of(problem):
    return dict(camera=problem.camera, points2d=problem.points2d, points3d=problem.points3d, name=problem.name)


def pairs_of(problem):
    return dict(references=problem.references, query2d=problem.query2d, reference2d=problem.reference2d,
                reference_index=problem.reference_index)


def of_raylift(arrays, **options):
    return lambda: raylift.estimate_pose(**arrays, **options).cam_from_world


def camera_dict(camera):
    return {"model": camera.model, "width": camera.width, "height": camera.height, "params": list(camera.params)}


def absolute_of_poselib(poselib, problem):
    arrays, camera = arrays_of(problem), camera_dict(problem.camera)

    def estimate():
        pose, found = poselib.estimate_absolute_pose(arrays["points2d"], arrays["points3d"], camera, THRESHOLDS_PX)
        return pose if found["num_inliers"] > 0 else None

    return estimate


def absolute_of_pycolmap(pycolmap, problem):
    arrays, camera = arrays_of(problem), pycolmap.Camera(**camera_dict(problem.camera))
    options = pycolmap.AbsolutePoseEstimationOptions()
    options.ransac.max_error = THRESHOLDS_PX["max_reproj_error"]

    def estimate():
        found = pycolmap.estimate_and_refine_absolute_pose(arrays["points2d"], arrays["points3d"], camera, options)
        return found and found["cam_from_world"]

    return estimate


def hybrid_of_poselib(poselib, problem):
    arrays, camera, index = arrays_of(problem), camera_dict(problem.camera), problem.reference_index
    matches, poses, cameras = [], [], []
    for r, reference in enumerate(problem.references):
        pair = poselib.PairwiseMatches()
        pair.cam_id1 = r
        pair.x1, pair.x2 = problem.reference2d[index == r], problem.query2d[index == r]
        matches.append(pair)
        pose = poselib.CameraPose()
        pose.q, pose.t = reference.cam_from_world.qvec, reference.cam_from_world.tvec
        poses.append(pose)
        cameras.append(camera_dict(reference.camera))
    return lambda: poselib.estimate_hybrid_pose(
        arrays["points2d"], arrays["points3d"], matches, camera, poses, cameras, THRESHOLDS_PX)[0]


def pose_table(title, problems, estimators):
    rows = []
    for name, prepare in estimators.items():
        times, degrees, units = [], [], []
        for truth, problem in problems:
            cpu, pose = cpu_ms(prepare(problem))
            times.append(cpu)
            pose = None if pose is None else raylift.Rigid3.of(pose)
            degrees.append(np.inf if pose is None else angle_deg(pose, truth))
            units.append(np.inf if pose is None else np.linalg.norm(pose.center - truth.center))
        rows.append((name, np.median(times), f"{np.median(degrees):.4f} deg", f"{np.median(units):.5f}",
                     f"{np.quantile(units, 0.9):.5f}"))
    print_table(title, ["rotation", "position", "90 % below"], rows)


def compare_poses(title, problems):
    poselib, pycolmap = peer("poselib"), peer("pycolmap")
    absolute = {
        "raylift p3p": lambda p: of_raylift(arrays_of(p), method="p3p"),
        "raylift p3p, paper": lambda p: of_raylift(arrays_of(p), method="p3p", refinement="paper"),
    }
    hybrid = {
        f"raylift {method}": lambda p, m=method: of_raylift({**arrays_of(p), **pairs_of(p)}, method=m)
        for method in ("adaptive", "select", "hybrid_ransac")
    }
    if poselib:
        absolute["poselib absolute"] = lambda p: absolute_of_poselib(poselib, p)
        hybrid["poselib hybrid"] = lambda p: hybrid_of_poselib(poselib, p)
    if pycolmap:
        absolute["pycolmap absolute"] = lambda p: absolute_of_pycolmap(pycolmap, p)
    pose_table(f"2D-3D matches: {title}", problems, absolute)
    pose_table(f"2D-3D and 2D-2D matches: {title}", problems, hybrid)
    batch = [problem for _, problem in problems] * 5
    alone = [raylift.PoseProblem(**arrays_of(problem)) for problem in batch]
    batches = {"raylift estimate_all": lambda: raylift.estimate_all(alone, method="p3p", independent=True)}
    if poselib:
        batches["poselib, in threads"] = in_threads([absolute_of_poselib(poselib, p) for p in batch])
    if pycolmap:
        batches["pycolmap, in threads"] = in_threads([absolute_of_pycolmap(pycolmap, p) for p in batch])
    rows = []
    for name, call in batches.items():
        call()
        start = time.perf_counter()
        cpu, _ = cpu_ms(call)
        rows.append((name, cpu, f"{(time.perf_counter() - start) * 1e3:.1f} ms"))
    print_table(f"{len(batch)} of these at once, 2D-3D matches, {os.cpu_count()} threads", ["by the clock"], rows)


def in_threads(calls):
    def run():
        with ThreadPoolExecutor(os.cpu_count()) as pool:
            return list(pool.map(lambda call: call(), calls))

    return run


# --- rays ---


def median_cpu_ms(call, repeat=15):
    call()
    return np.median([cpu_ms(call)[0] for _ in range(repeat)])


def exact_ray_t(mesh, triangles, origin, directions):
    """In double, along the rays to the planes of the triangles that they hit."""
    a, b, c = (mesh.vertices[mesh.triangles[triangles, k]] for k in range(3))
    normals = np.cross(b - a, c - a)
    return ((a - origin) * normals).sum(axis=1) / (directions * normals).sum(axis=1)


def accuracy(ray_t, hit, exact):
    """The median relative error, and how many rays are 0.1 % off, or find a surface where there is none."""
    found = np.isfinite(ray_t) & (ray_t > 0)
    error = np.full(len(hit), np.inf)
    error[hit & found] = np.abs(ray_t[hit & found] / exact[found[hit]] - 1)
    error[~hit & ~found] = 0
    return f"{np.median(error[hit]):.1e}", f"{100 * (error > 1e-3).mean():.4f} %"


def compare_rays():
    mesh = raylift.Mesh.read(ROOT / "assets/demo/scene.obj")
    image = raylift.ColmapModel.read(ROOT / "assets/demo/model").posed_images[0]
    camera = raylift.Camera("PINHOLE", 640, 480, [500, 500, 320, 240])
    x, y = np.meshgrid(np.arange(640) + 0.5, np.arange(480) + 0.5)
    in_cam = np.column_stack([(x.ravel() - 320) / 500, (y.ravel() - 240) / 500, np.ones(x.size)])
    pose = image.cam_from_world
    directions = np.ascontiguousarray(in_cam @ pose.rotation)  # of the length at which ray_t is the depth
    caster = raylift.RayCaster(mesh)
    first = caster.cast([pose.center], directions, threads=1)
    hit = first["triangles"] >= 0
    exact = exact_ray_t(caster.mesh, first["triangles"][hit], pose.center, directions[hit])

    rows = [("raylift cast", median_cpu_ms(lambda: caster.cast([pose.center], directions, threads=1)),
             *accuracy(first["ray_t"], hit, exact))]
    open3d = peer("open3d")
    if open3d:
        scene = open3d.t.geometry.RaycastingScene(nthreads=1)
        scene.add_triangles(mesh.vertices.astype(np.float32), mesh.triangles)
        rays = np.hstack([np.tile(pose.center, (len(directions), 1)), directions]).astype(np.float32)
        ray_t = scene.cast_rays(rays, nthreads=1)["t_hit"].numpy()
        rows.append(("open3d cast_rays", median_cpu_ms(lambda: scene.cast_rays(rays, nthreads=1)),
                     *accuracy(ray_t.astype(float), hit, exact)))
    trimesh = peer("trimesh")
    embree = trimesh and peer("embreex") and peer("trimesh.ray.ray_pyembree")
    if embree:
        caster_of_trimesh = embree.RayMeshIntersector(trimesh.Trimesh(mesh.vertices, mesh.triangles, process=False))
        origins = np.tile(pose.center, (len(directions), 1))

        def intersect():
            return caster_of_trimesh.intersects_location(origins, directions, multiple_hits=False)

        places, of_ray, _ = intersect()
        ray_t = np.full(len(directions), np.nan)
        ray_t[of_ray] = ((places - pose.center) * directions[of_ray]).sum(axis=1) / (directions[of_ray] ** 2).sum(axis=1)
        rows.append(("trimesh with embreex", median_cpu_ms(intersect), *accuracy(ray_t, hit, exact)))
    title = f"307,200 rays in arrays, {len(mesh.triangles)} triangles"
    print_table(title, ["error of depth", "0.1 % off"], rows)

    def render():
        return caster.render(camera, pose, ["depth"], threads=1)["depth"]

    rows = [("raylift render", median_cpu_ms(render), *accuracy(render().ravel().astype(float), hit, exact))]
    of_pyrender = render_by_pyrender(mesh, camera, pose)
    if of_pyrender:
        rows.append(("pyrender", median_cpu_ms(of_pyrender), *accuracy(of_pyrender().ravel(), hit, exact)))
    print_table("Depth image, 640 x 480", ["error of depth", "0.1 % off"], rows)


def render_by_pyrender(mesh, camera, pose):
    os.environ.setdefault("PYOPENGL_PLATFORM", "egl")
    pyrender, trimesh = peer("pyrender"), peer("trimesh")
    if not (pyrender and trimesh):
        return None
    try:
        fx, fy, cx, cy = camera.params
        scene = pyrender.Scene()
        scene.add(pyrender.Mesh.from_trimesh(trimesh.Trimesh(mesh.vertices, mesh.triangles, process=False)))
        # OpenGL's cameras look along -z, with y up.
        scene.add(pyrender.IntrinsicsCamera(fx, fy, cx, cy, znear=0.05, zfar=100),
                  pose=pose.inverse().matrix @ np.diag([1, -1, -1, 1]))
        renderer = pyrender.OffscreenRenderer(camera.width, camera.height)
        flags = pyrender.RenderFlags.DEPTH_ONLY | pyrender.RenderFlags.SKIP_CULL_FACES
        renderer.render(scene, flags=flags)
    except Exception as error:
        print(f"  pyrender is left out: it does not start without a display: {error}")
        return None
    return lambda: renderer.render(scene, flags=flags).astype(float)


if __name__ == "__main__":
    print_versions()
    compare_poses("made here", list(made_problems()))
    for folder in sys.argv[1:]:
        compare_poses(folder, list(problems_in(folder)))
    compare_rays()
