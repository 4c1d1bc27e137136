"""How often `raylift localize` is sure of a wrong place along a facade of equal panels, as a table in Markdown.

repeated_facade.py RAYLIFT OUT SEED...: of each seed a facade of 14 panels of 4 m, all equal but for --unique of
them, with references each 2 m and a walk of 60 photographs, alone and with their odometry (1 % of drift). A pose
is wrong that is half a panel off.
"""

import argparse
import json
import subprocess
from pathlib import Path

import cv2
import numpy as np

PANELS, WIDTH, HEIGHT, PX = 14, 4.0, 5.0, 160  # meters, and pixels of the texture in one
CAMERA = "PINHOLE 640 480 520 520 320 240"
# Columns and rows of a panel with their depths: a facade is no plane.
COLUMNS = [(0, 0.6, 0.0), (0.6, 1.8, 0.5), (1.8, 2.4, 0.1), (2.4, 3.6, 0.6), (3.6, 4.0, 0.0)]
ROWS = [(0, 1.2, 0.0), (1.2, 3.4, 0.25), (3.4, HEIGHT, -0.1)]


def panel(rng):
    size = (int(WIDTH * PX), int(HEIGHT * PX))
    noise = cv2.resize(rng.normal(0, 25, (size[1] // 4, size[0] // 4, 3)), size, interpolation=cv2.INTER_CUBIC)
    image = np.clip(150 + noise, 0, 255).astype(np.uint8)
    for _ in range(60):
        corner = tuple(int(rng.integers(0, side)) for side in size)
        side, color = int(rng.integers(4, 40)), [int(x) for x in rng.integers(0, 255, 3)]
        if rng.random() < 0.5:
            opposite = (corner[0] + side, corner[1] + int(side * rng.uniform(0.5, 2)))
            cv2.rectangle(image, corner, opposite, color, -1)
        else:
            cv2.circle(image, corner, side // 2, color, -1)
    return image


def write_facade(folder, rng, unique):
    """scene.obj: z = 0 and behind it, y up, x from 0 on."""
    common = panel(rng)
    cv2.imwrite(str(folder / "facade.png"),
                np.hstack([panel(rng) if i in unique else common for i in range(PANELS)]))
    (folder / "scene.mtl").write_text("newmtl facade\nmap_Kd facade.png\n")
    corners, faces = [], []
    for i in range(PANELS):
        for left, right, depth in COLUMNS:
            for low, high, behind in ROWS:
                corners += [(i * WIDTH + x, y, depth + behind)
                            for x, y in ((left, low), (right, low), (right, high), (left, high))]
                first = len(corners) - 3
                faces += [(first, first + 1, first + 2), (first, first + 2, first + 3)]
    lines = ["mtllib scene.mtl", "usemtl facade"]
    lines += [f"v {x:.4f} {y:.4f} {z:.4f}" for x, y, z in corners]
    lines += [f"vt {x / (PANELS * WIDTH):.8f} {y / HEIGHT:.8f}" for x, y, _ in corners]
    lines += ["f " + " ".join(f"{c}/{c}" for c in face) for face in faces]
    (folder / "scene.obj").write_text("\n".join(lines) + "\n")


def pose(center, yaw, pitch):
    """World to camera, as quaternion and translation, of a camera that looks along z."""
    forward = np.array([np.sin(yaw) * np.cos(pitch), np.sin(pitch), np.cos(yaw) * np.cos(pitch)])
    right = np.cross(forward, (0, 1, 0))
    right /= np.linalg.norm(right)
    rotation = np.stack([right, np.cross(forward, right), forward])
    turn = cv2.Rodrigues(rotation)[0].ravel()
    angle = np.linalg.norm(turn)
    return [np.cos(angle / 2), *(np.sin(angle / 2) * turn / angle)], -rotation @ center


def write_model(folder, poses):
    """A COLMAP model without points."""
    folder.mkdir()
    (folder / "cameras.txt").write_text(f"1 {CAMERA}\n")
    (folder / "points3D.txt").write_text("")
    lines = [f"{i + 1} {' '.join(f'{x:.12g}' for x in (*q, *t))} 1 {name}\n\n"
             for i, (name, (q, t)) in enumerate(poses.items())]
    (folder / "images.txt").write_text("".join(lines))


def write_views(folder, rng):
    end = PANELS * WIDTH
    references = {f"ref_{i:03d}.png": pose((x, rng.uniform(1.4, 2.2), -4.5 + rng.uniform(-0.3, 0.3)),
                                           rng.uniform(-0.15, 0.15), rng.uniform(-0.05, 0.1))
                  for i, x in enumerate(np.arange(1.5, end - 1, 2.0))}
    walk = {f"walk_{i:03d}.png": pose((x, 1.7 + 0.05 * np.sin(3 * x), -4 + 0.5 * np.sin(x / 7)),
                                      0.1 * np.sin(x / 5), 0.03 * np.cos(x))
            for i, x in enumerate(np.linspace(3, end - 3, 60))}
    write_model(folder / "refs", references)
    write_model(folder / "walk", walk)
    (folder / "queries.txt").write_text("".join(f"{name} {CAMERA}\n" for name in walk))
    return {name: center(q, t) for name, (q, t) in walk.items()}


def photograph(folder, rng):
    for file in sorted((folder / "images").rglob("*.png")):
        image = cv2.GaussianBlur(cv2.imread(str(file)).astype(float), (0, 0), 0.7)
        image = (image + rng.normal(0, 3, image.shape)) * rng.uniform(0.85, 1.1)
        cv2.imwrite(str(file), np.clip(image, 0, 255).astype(np.uint8))


def center(q, t):
    w, x, y, z = q
    rotation = np.array([[1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
                         [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
                         [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)]])
    return -rotation.T @ np.asarray(t)


def counts(truth, result):
    poses = wrong = localized = wrong_localized = 0
    for line in result.read_text().splitlines():
        query = json.loads(line)
        if query["status"] != "ok":
            continue
        pose = query["cam_from_world"]
        is_wrong = np.linalg.norm(center(pose["qvec"], pose["tvec"]) - truth[query["name"]]) > WIDTH / 2
        is_sure = query["verdict"] == "localized"
        poses, wrong, localized = poses + 1, wrong + is_wrong, localized + is_sure
        wrong_localized += is_wrong and is_sure
    return poses, wrong, localized, wrong_localized


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("raylift")
    parser.add_argument("out", type=Path)
    parser.add_argument("seeds", type=int, nargs="+")
    parser.add_argument("--unique", default="2,11", help="panels, from 0")
    given = parser.parse_args()
    raylift = Path(given.raylift).resolve()
    unique = {int(x) for x in given.unique.split(",") if x}
    print("| seed | photographs | poses | wrong | localized | of them wrong |\n|---|---|---|---|---|---|")
    for seed in given.seeds:
        folder = given.out / str(seed)
        folder.mkdir(parents=True)
        rng = np.random.default_rng(seed)
        write_facade(folder, rng, unique)
        truth = write_views(folder, rng)

        def run(*arguments):
            subprocess.run([raylift, *arguments], check=True, cwd=folder, capture_output=True)

        geometry = ("--geometry", "mesh:scene.obj")
        for views in ("refs", "walk"):
            run("render", *geometry, "--model", views, "--products", "color", "--shading", "unlit",
                "--supersampling", "2", "--out", f"rendered_{views}")
            (folder / "images").mkdir(exist_ok=True)
            for file in (folder / f"rendered_{views}" / "color").iterdir():
                file.rename(folder / "images" / file.name)
        photograph(folder, rng)
        run("perturb", "--model", "walk", "--walk", "--out", "odometry", "--drift", "0.01",
            "--turn-drift-deg", "0.5", "--seed", str(seed))
        localize = ("localize", *geometry, "--model", "refs", "--images", "images", "--queries", "queries.txt",
                    "--query-images", "images", "--cache", "cache")
        run(*localize, "--out", "alone")
        run(*localize, "--out", "walked", "--odometry", "odometry/odometry.txt", "--times", "odometry/times.txt")
        for title, result in (("alone", "alone"), ("with odometry", "walked")):
            numbers = " | ".join(str(x) for x in counts(truth, folder / result / "queries.jsonl"))
            print(f"| {seed} | {title} | {numbers} |", flush=True)


if __name__ == "__main__":
    main()
