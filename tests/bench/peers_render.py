"""Depth images by Raylift, by Open3D and by trimesh's embreex: CPU time per image, and of whole programs.

peers_render.py RAYLIFT [MILLIONS_OF_TRIANGLES...]   (default: 0.1 1 5)

RAYLIFT is the program; the module `raylift` has to be importable. A bumpy ball is seen from within. Per image: a
pinhole image's depth in memory, on one thread, the median of several views. End to end: a PLY file is read, 10 and
100 images of 640 x 480 are written as .npy, by as many threads as each takes by default; the time is the CPU time of
the process and, for Open3D, that of a process that only imports it is told beside it. Ratios: the peer's over
Raylift's. A peer that is not installed is left out.
"""

import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

import raylift

SIZES = [(320, 240), (640, 480), (1920, 1080)]
OPEN3D_LOOP = """
import sys
import numpy as np
import open3d as o3d
if len(sys.argv) > 1:
    mesh = o3d.t.io.read_triangle_mesh(sys.argv[1])
    scene = o3d.t.geometry.RaycastingScene()
    scene.add_triangles(mesh)
    views = np.load(sys.argv[2])
    for i, pose in enumerate(views["poses"]):
        rays = scene.create_rays_pinhole(views["K"], pose, 640, 480)
        depth = scene.cast_rays(rays)["t_hit"].numpy()
        depth[~np.isfinite(depth)] = 0
        np.save(f"{sys.argv[3]}/{i:04}.npy", depth)
"""


def bumpy_ball(num_triangles):
    """A latitude-longitude grid of radius 5 with bumps, facing inwards."""
    rows = int(round(np.sqrt(num_triangles / 4)))
    columns = 2 * rows
    theta = np.linspace(0.02, np.pi - 0.02, rows + 1)[:, None]
    phi = np.linspace(0, 2 * np.pi, columns + 1)[None, :]
    radius = 5 + 0.2 * np.sin(9 * phi) * np.sin(13 * theta) + 0.02 * np.sin(140 * phi) * np.sin(170 * theta)
    vertices = np.stack([radius * np.sin(theta) * np.cos(phi), radius * np.sin(theta) * np.sin(phi),
                         radius * np.cos(theta) + 0 * phi], axis=-1).reshape(-1, 3)
    corner = (np.arange(rows)[:, None] * (columns + 1) + np.arange(columns)[None, :]).ravel()
    below = corner + columns + 1
    triangles = np.concatenate([np.stack([corner, corner + 1, below], 1), np.stack([corner + 1, below + 1, below], 1)])
    return vertices, triangles.astype(np.uint32)


def write_ply(path, vertices, triangles):
    faces = np.empty(len(triangles), dtype=[("count", "u1"), ("corners", "<i4", 3)])
    faces["count"], faces["corners"] = 3, triangles
    header = (f"ply\nformat binary_little_endian 1.0\nelement vertex {len(vertices)}\nproperty float x\n"
              f"property float y\nproperty float z\nelement face {len(triangles)}\n"
              "property list uchar int vertex_indices\nend_header\n")
    path.write_bytes(header.encode() + vertices.astype("<f4").tobytes() + faces.tobytes())


def poses(count):
    """World to camera, all around, a little off the middle."""
    made = []
    for i in range(count):
        a, b = 2.4 * i, 0.5 * np.sin(1.7 * i)
        forward = np.array([np.cos(a) * np.cos(b), np.sin(a) * np.cos(b), np.sin(b)])
        right = np.cross(forward, [0, 0, 1])
        right /= np.linalg.norm(right)
        rotation = np.stack([right, np.cross(forward, right), forward])
        pose = np.eye(4)
        pose[:3, :3] = rotation
        pose[:3, 3] = -rotation @ np.array([np.cos(i), np.sin(i), 0.3])
        made.append(pose)
    return made


def intrinsics(width, height):
    return np.array([[0.8 * width, 0, width / 2], [0, 0.8 * width, height / 2], [0, 0, 1]])


def median_ms(render, views):
    render(views[0])
    times = []
    for _ in range(3):
        for view in views:
            start = time.process_time_ns()
            render(view)
            times.append((time.process_time_ns() - start) / 1e6)
    return np.median(times)


def peers_of(vertices, triangles):
    """Name and, for an image size, a function of a pose that renders its depth."""
    made = {}
    try:
        import open3d

        scene = open3d.t.geometry.RaycastingScene(nthreads=1)
        scene.add_triangles(vertices.astype(np.float32), triangles)

        def of_open3d(width, height):
            matrix = intrinsics(width, height)
            return lambda pose: scene.cast_rays(
                scene.create_rays_pinhole(matrix, pose, width, height), nthreads=1)["t_hit"].numpy()

        made["Open3D"] = of_open3d
    except ImportError as error:
        print(f"Open3D is left out: {error}")
    try:
        from embreex import rtcore_scene
        from embreex.mesh_construction import TriangleMesh

        embree_scene = rtcore_scene.EmbreeScene()
        TriangleMesh(embree_scene, vertices.astype(np.float32), triangles.astype(np.int32))

        def of_embreex(width, height):
            fx, cx, cy = 0.8 * width, width / 2, height / 2
            x, y = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
            in_cam = np.stack([(x.ravel() - cx) / fx, (y.ravel() - cy) / fx, np.ones(x.size)], 1)

            def render(pose):
                directions = (in_cam @ pose[:3, :3]).astype(np.float32)
                origins = np.tile((-pose[:3, :3].T @ pose[:3, 3]).astype(np.float32), (len(directions), 1))
                return embree_scene.run(origins, directions, query="DISTANCE").reshape(height, width)

            return render

        made["embreex"] = of_embreex
    except ImportError as error:
        print(f"embreex is left out: {error}")
    return made


def compare_images(num_triangles):
    vertices, triangles = bumpy_ball(num_triangles)
    caster = raylift.RayCaster(raylift.Mesh(vertices, triangles))
    peers = peers_of(vertices, triangles)
    views = poses(6)
    for width, height in SIZES:
        matrix = intrinsics(width, height)
        camera = raylift.Camera("PINHOLE", width, height, [matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2]])
        rigid = {id(view): raylift.Rigid3(view[:3, :3], view[:3, 3]) for view in views}
        own = median_ms(lambda view, c=camera, r=rigid: caster.render(c, r[id(view)], ["depth"], threads=1), views)
        rates = width * height / own / 1e3
        line = f"{len(triangles) / 1e6:5.1f} M  {width:4} x {height:4}  Raylift {own:7.2f} ms ({rates:5.1f} Mrays/s)"
        for name, of_size in peers.items():
            peer = median_ms(of_size(width, height), views)
            line += f"   {name} {peer:8.2f} ms, ratio {peer / own:5.1f}"
        print(line, flush=True)


def cpu_s(command):
    process = subprocess.Popen([str(part) for part in command], stdout=subprocess.DEVNULL)
    _, status, usage = os.wait4(process.pid, 0)
    process.returncode = status
    if status != 0:
        raise RuntimeError(f"{command[0]} ended with {status}")
    return usage.ru_utime + usage.ru_stime


def compare_programs(program, num_triangles, folder):
    vertices, triangles = bumpy_ball(num_triangles)
    mesh = folder / "ball.ply"
    write_ply(mesh, vertices, triangles)
    for count in (10, 100):
        views = poses(count)
        matrix = intrinsics(640, 480)
        with open(folder / "cameras.txt", "w", encoding="utf-8") as file:
            for i, pose in enumerate(views):
                rigid = raylift.Rigid3(pose[:3, :3], pose[:3, 3])
                numbers = [*rigid.qvec, *rigid.tvec]
                camera = f"PINHOLE 640 480 {matrix[0, 0]} {matrix[1, 1]} {matrix[0, 2]} {matrix[1, 2]}"
                file.write(f"{i:04}.jpg {' '.join(repr(float(n)) for n in numbers)} {camera}\n")
        np.savez(folder / "views.npz", K=matrix, poses=np.stack(views))
        own = cpu_s([program, "render", "--geometry", f"mesh:{mesh}", "--cameras", folder / "cameras.txt", "--out",
                     folder / "own", "--format", "depth=npy", "--overwrite", "--quiet"])
        (folder / "peer").mkdir(exist_ok=True)
        idle = cpu_s([sys.executable, "-c", OPEN3D_LOOP])
        peer = cpu_s([sys.executable, "-c", OPEN3D_LOOP, mesh, folder / "views.npz", folder / "peer"])
        print(f"{len(triangles) / 1e6:5.1f} M  {count:3} images  Raylift {own:6.2f} s   Open3D {peer:6.2f} s "
              f"({idle:.2f} s to import), ratio {peer / own:4.1f}, without the import {(peer - idle) / own:4.1f}", flush=True)


if __name__ == "__main__":
    sizes = [1e6 * float(text) for text in sys.argv[2:] or ("0.1", "1", "5")]
    for size in sizes:
        compare_images(size)
    with tempfile.TemporaryDirectory() as work:
        for size in sizes:
            compare_programs(Path(sys.argv[1]).resolve(), size, Path(work))
