"""What odometry gives `raylift localize` along a walk, as a table in Markdown.

walks.py RAYLIFT OUT --images FOLDER --models MODEL... --geometry SPEC: the images of the COLMAP models (text), in
the order of the numbers in their names, are a walk; each --every-th is a reference, the others are localized, alone
and with odometry that `raylift perturb` makes of their poses. With --rendered N the walk goes through the mesh, and
its photographs are rendered; --blur moves the camera while they are taken, and --covered of them show something
else. Each line is the sum over the --seeds. A pose is right within 10 cm and 1 degree, and wrong beyond 25 cm or 5
degrees.
"""

import argparse
import json
import re
import shutil
import struct
import subprocess
from pathlib import Path

import cv2
import numpy as np

ODOMETRY = {
    "0.5 %": ["--drift", ".005", "--turn-drift-deg", ".25"],
    "1 %": ["--drift", ".01", "--turn-drift-deg", ".5"],
    "3 %": ["--drift", ".03", "--turn-drift-deg", "1.5"],
    "1 %, lost": ["--drift", ".01", "--turn-drift-deg", ".5", "--lost", ".05"],
    "1 %, dropouts": ["--drift", ".01", "--turn-drift-deg", ".5", "--dropout", ".2"],
    "1 %, unknown scale": ["--drift", ".01", "--turn-drift-deg", ".5", "--unit", "2.5"],
}


def number_of(name):
    return int(re.findall(r"\d+", name)[-1])


class Images:
    """The images of models, in the order of the walk, and the folder of their photographs."""

    def __init__(self, models, folder):
        self.cameras, self.images, self.folder = {}, [], folder
        for model in models:
            lines = [line for line in (model / "cameras.txt").read_text().splitlines() if line[:1] not in ("#", "")]
            cameras = {line.split()[0]: line.split(maxsplit=1)[1] for line in lines}
            for camera in cameras.values():
                self.cameras.setdefault(camera, len(self.cameras) + 1)
            lines = [line for line in (model / "images.txt").read_text().splitlines() if not line.startswith("#")]
            for line in lines[::2]:
                _, *pose, camera, name = line.split()
                self.images.append((name, [float(x) for x in pose], cameras[camera]))
        self.images.sort(key=lambda image: (number_of(image[0]), image[0]))

    def take_walk(self, model, camera, folder):
        """Takes the images of a model that `raylift views` wrote, whose photographs are PNG."""
        data = (model / "images.bin").read_bytes()
        at = 8
        for _ in range(struct.unpack_from("<Q", data)[0]):
            pose = list(struct.unpack_from("<7d", data, at + 4))
            end = data.index(b"\0", at + 64)
            name = str(Path(data[at + 64:end].decode()).with_suffix(".png"))
            self.images.append((name, pose, camera))
            at = end + 9
        self.cameras, self.folder = {camera: 1}, folder

    def write_model(self, folder, images):
        folder.mkdir(parents=True)
        (folder / "cameras.txt").write_text("".join(f"{i} {camera}\n" for camera, i in self.cameras.items()))
        (folder / "points3D.txt").write_text("")
        (folder / "images.txt").write_text("".join(
            f"{i + 1} {' '.join(repr(x) for x in pose)} {self.cameras[camera]} {name}\n\n"
            for i, (name, pose, camera) in enumerate(images)))


def photograph(images, folder, blur, noise, covered):
    """Writes the photographs of images with noise, and blurred by so many pixels along a line; a share of them shows
    a pattern that is nowhere in the map."""
    rng = np.random.default_rng(0)
    for name, _, _ in images.images:
        image = cv2.imread(str(images.folder / name)).astype(float)
        if rng.random() < covered:
            height, width, _ = image.shape
            pattern = rng.uniform(0, 255, (height // 8, width // 8, 3))
            image = cv2.resize(pattern, (width, height), interpolation=cv2.INTER_CUBIC)
        if blur > 1:
            line = np.zeros((blur, blur))
            angle = rng.uniform(0, np.pi)
            middle = (blur - 1) // 2
            end = np.int32(np.round(middle * np.array([np.cos(angle), np.sin(angle)])))
            cv2.line(line, (middle - end).tolist(), (middle + end).tolist(), 1)
            line += line[::-1, ::-1]
            image = cv2.filter2D(image, -1, line / line.sum())
        image += rng.normal(0, noise, image.shape)
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        cv2.imwrite(str(folder / name), np.clip(image, 0, 255).astype(np.uint8), [cv2.IMWRITE_JPEG_QUALITY, 95])
    images.folder = folder


def rotation_of(q):
    w, x, y, z = np.asarray(q) / np.linalg.norm(q)
    return np.array([[1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
                     [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
                     [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)]])


def turn_of(rotation):
    """The rotation vector of a matrix."""
    cosine = np.clip((np.trace(rotation) - 1) / 2, -1, 1)
    axis = np.array([rotation[2, 1] - rotation[1, 2], rotation[0, 2] - rotation[2, 0], rotation[1, 0] - rotation[0, 1]])
    length = np.linalg.norm(axis)
    return axis * (np.arccos(cosine) / length if length > 1e-12 else 0.5)


class Tally:
    """Errors of the poses of one kind."""

    def __init__(self):
        self.position, self.turn_deg, self.nees, self.wrong, self.sure = [], [], [], 0, 0

    def add(self, pose, covariance, verdict, truth):
        if pose is None:
            self.position.append(np.inf)
            self.turn_deg.append(np.inf)
            return
        (q, t), (true_q, true_t) = pose, truth
        R, true_R = rotation_of(q), rotation_of(true_q)
        step = np.concatenate([turn_of(true_R @ R.T), np.asarray(true_t) - true_R @ R.T @ np.asarray(t)])
        self.position.append(np.linalg.norm(R.T @ t - true_R.T @ true_t))
        self.turn_deg.append(np.degrees(np.linalg.norm(step[:3])))
        is_sure = verdict == "localized"
        self.sure += is_sure
        self.wrong += is_sure and (self.position[-1] > 0.25 or self.turn_deg[-1] > 5)
        if covariance is not None and is_sure:
            self.nees.append(step @ np.linalg.solve(covariance, step) / 6)

    def right(self):
        return np.sum((np.array(self.position) < 0.1) & (np.array(self.turn_deg) < 1))

    def median_cm(self, share=0.5):
        value = 100 * np.sort(self.position)[int(share * (len(self.position) - 1))]
        return f"{value:.2f}" if np.isfinite(value) else "fails"


def covariance_of(query):
    return np.array(query["covariance"]).reshape(6, 6) if "covariance" in query else None


def pose_of(json_pose):
    return json_pose and (json_pose["qvec"], np.array(json_pose["tvec"]))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("raylift")
    parser.add_argument("out", type=Path)
    parser.add_argument("--images", type=Path, required=True)
    parser.add_argument("--models", type=Path, nargs="+", required=True)
    parser.add_argument("--geometry", required=True)
    parser.add_argument("--every", type=int, nargs="+", default=[5, 10, 20])
    parser.add_argument("--features", type=int, nargs="+", default=[4096, 300])
    parser.add_argument("--odometry", nargs="+", default=list(ODOMETRY), choices=list(ODOMETRY))
    parser.add_argument("--seeds", type=int, nargs="+", default=[1, 2, 3])
    parser.add_argument("--rendered", type=int, default=0, help="photographs of a walk through the mesh")
    parser.add_argument("--blur", type=int, default=0, help="pixels, an odd number")
    parser.add_argument("--covered", type=float, default=0, help="share of photographs that show something else")
    parser.add_argument("--options", default="", help="more options of localize with odometry")
    given = parser.parse_args()
    raylift = Path(given.raylift).resolve()

    def run(*arguments):
        subprocess.run([raylift, *map(str, arguments)], check=True, capture_output=True)

    references = walk = Images(given.models, given.images)
    if given.rendered:
        made = given.out / "rendered"
        if not made.exists():
            run("views", "--geometry", given.geometry, "--mode", "walk", "--count", given.rendered, "--camera",
                references.images[0][2], "--out", made)
            run("render", "--geometry", given.geometry, "--model", made, "--products", "color", "--shading", "unlit",
                "--supersampling", "2", "--format", "color=png", "--out", made / "photographs")
        walk = Images([], None)
        walk.take_walk(made, references.images[0][2], made / "photographs/color")
    if given.rendered or given.blur or given.covered:
        photograph(walk, given.out / "photographs", given.blur, 3, given.covered)
    truth = {name: (pose[:4], np.array(pose[4:])) for name, pose, _ in walk.images}

    print("| every, features, odometry | frames | right alone | walk | rescued | median cm | | p95 cm | | NEES/6 | "
          "| wrong, localized | |\n|" + "---|" * 13)
    for every in given.every:
        folder = given.out / f"every_{every}"
        if not folder.exists():
            references.write_model(folder / "refs", references.images[::every])
            frames = [image for i, image in enumerate(walk.images) if walk is not references or i % every]
            walk.write_model(folder / "walk", frames)
            (folder / "queries.txt").write_text("".join(f"{name} {camera}\n" for name, _, camera in frames))
            (folder / "times.txt").write_text("".join(f"{name} {number_of(name)}\n" for name, _, _ in frames))
        for features in given.features:
            localize = ["localize", "--geometry", given.geometry, "--model", folder / "refs", "--images", given.images,
                        "--queries", folder / "queries.txt", "--query-images", walk.folder, "--max-features", features,
                        "--cache", given.out / f"cache_{features}", "--no-doctor"]
            alone = folder / f"alone_{features}"
            if not alone.exists():
                run(*localize, "--out", alone)
            for odometry in given.odometry:
                single, walked, failing, rescued = Tally(), Tally(), 0, 0
                for seed in given.seeds:
                    made = folder / f"odometry_{odometry}_{seed}"
                    if not made.exists():
                        run("perturb", "--model", folder / "walk", "--walk", "--times", folder / "times.txt", "--out",
                            made, *ODOMETRY[odometry], "--seed", seed)
                    out = folder / "walked"
                    shutil.rmtree(out, ignore_errors=True)
                    shutil.copytree(alone, out)
                    scale = ["--odometry-scale", "unknown"] if "scale" in odometry else []
                    run(*localize, "--out", out, "--resume", "--odometry", made / "odometry.txt", "--times",
                        folder / "times.txt", *scale, *given.options.split())
                    before = [json.loads(line) for line in (alone / "queries.jsonl").read_text().splitlines()]
                    after = [json.loads(line) for line in (out / "queries.jsonl").read_text().splitlines()]
                    for a, b in zip(before, after):
                        for tally, query in ((single, a), (walked, b)):
                            tally.add(pose_of(query.get("cam_from_world")), covariance_of(query), query["verdict"],
                                      truth[query["name"]])
                        is_right = [tally.position[-1] < 0.1 and tally.turn_deg[-1] < 1 for tally in (single, walked)]
                        failing += not is_right[0]
                        rescued += not is_right[0] and is_right[1]
                print(f"| {every}, {features}, {odometry} | {len(single.position)} | {single.right()} | {walked.right()} | "
                      f"{rescued} of {failing} | {single.median_cm()} | {walked.median_cm()} | {single.median_cm(.95)} | "
                      f"{walked.median_cm(.95)} | {np.mean(single.nees):.2f} | {np.mean(walked.nees):.2f} | "
                      f"{single.wrong} of {single.sure} | {walked.wrong} of {walked.sure} |", flush=True)


if __name__ == "__main__":
    main()
