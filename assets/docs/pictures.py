"""Makes the pictures of the concepts and the pages of the gallery, on the demo:
pictures.py RAYLIFT DEMO_FOLDER PAGES_FOLDER. The working folder holds what they are made of.
"""

import array
import base64
import json
import math
import random
import re
import shutil
import statistics
import subprocess
import sys
from pathlib import Path

QUERY = "query/query_02.jpg"
BLUE, GREEN, ORANGE, GRAY = "#2a6fb8", "#2a9d5c", "#e07b00", "#888888"
# From above the yard's north-east corner to the walls that the query shows.
OVERVIEW_CENTER, OVERVIEW_TARGET = (15.0, 20.0, 23.0), (6.0, 5.0, 1.0)
OVERVIEW_WIDTH, OVERVIEW_HEIGHT, OVERVIEW_FOCAL = 560, 420, 520
MOST_LEFT = 40  # keypoints


def run(*words):
    subprocess.run([str(word) for word in words], check=True, stdout=subprocess.DEVNULL)


# Poses are (rotation's rows, translation), world to camera.


def rotation_of(qvec):
    w, x, y, z = qvec
    return [[1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)]]


def to_camera(pose, point):
    rows, t = pose
    return [sum(r * p for r, p in zip(row, point)) + shift for row, shift in zip(rows, t)]


def to_world(pose, point):
    rows, t = pose
    moved = [p - shift for p, shift in zip(point, t)]
    return [sum(rows[i][j] * moved[i] for i in range(3)) for j in range(3)]


def pose_of(record):
    return rotation_of(record["qvec"]), record["tvec"]


def read_poses(file):
    lines = (line.split() for line in file.read_text(encoding="utf-8").splitlines())
    return {words[0]: (rotation_of([*map(float, words[1:5])]), [*map(float, words[5:8])]) for words in lines}


def overview_pose():
    """The pose from which the yard is shown, and its line in a list of cameras."""
    forward = [b - a for a, b in zip(OVERVIEW_CENTER, OVERVIEW_TARGET)]
    length = math.hypot(*forward)
    forward = [f / length for f in forward]
    across = math.hypot(forward[0], forward[1])
    right = [forward[1] / across, -forward[0] / across, 0.0]
    down = [forward[1] * right[2] - forward[2] * right[1], forward[2] * right[0] - forward[0] * right[2],
            forward[0] * right[1] - forward[1] * right[0]]
    rows = [right, down, forward]
    t = [-sum(r * c for r, c in zip(row, OVERVIEW_CENTER)) for row in rows]
    w = math.sqrt(1 + rows[0][0] + rows[1][1] + rows[2][2]) / 2
    qvec = [w, (rows[2][1] - rows[1][2]) / (4 * w), (rows[0][2] - rows[2][0]) / (4 * w),
            (rows[1][0] - rows[0][1]) / (4 * w)]
    return (rows, t), " ".join(map(str, ["overview.jpg", *qvec, *t, "SIMPLE_PINHOLE", OVERVIEW_WIDTH, OVERVIEW_HEIGHT,
                                         OVERVIEW_FOCAL, OVERVIEW_WIDTH / 2, OVERVIEW_HEIGHT / 2]))


def svg(width, height, parts):
    return (f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" width="{width}" '
            f'height="{height}" font-family="sans-serif" font-size="14">\n'
            f'<rect width="{width}" height="{height}" fill="white"/>\n' + "\n".join(parts) + "\n</svg>\n")


def picture(data, x, y, width, height):
    return f'<image x="{x}" y="{y}" width="{width}" height="{height}" href="{data}"/>'


def jpeg(file):
    return "data:image/jpeg;base64," + base64.b64encode(file.read_bytes()).decode()


def line(a, b, color, width=1.5, dashes=""):
    return (f'<line x1="{a[0]:.1f}" y1="{a[1]:.1f}" x2="{b[0]:.1f}" y2="{b[1]:.1f}" stroke="{color}" '
            f'stroke-width="{width}" stroke-dasharray="{dashes}"/>')


def dot(at, color, radius=4.0, opacity=1.0):
    return (f'<circle cx="{at[0]:.1f}" cy="{at[1]:.1f}" r="{radius}" fill="{color}" fill-opacity="{opacity}" '
            'stroke="white"/>')


def text(at, words, anchor="start", color="black", more=""):
    return f'<text x="{at[0]:.1f}" y="{at[1]:.1f}" text-anchor="{anchor}" fill="{color}" {more}>{words}</text>'


def draw_camera(show, pose, color, size=1.6):
    """A pyramid of the 4:3 picture, `size` long."""
    apex = show(to_world(pose, (0, 0, 0)))
    corners = [show(to_world(pose, (x * size * 0.68, y * size * 0.51, size)))
               for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    return [*(line(apex, corner, color) for corner in corners),
            *(line(a, b, color) for a, b in zip(corners, corners[1:] + corners[:1]))]


def lifting(raylift, demo, problem, poses):
    """Matches that become 2D-3D matches by the rays of the reference's keypoints."""
    overview, entry = overview_pose()
    Path("overview.txt").write_text(entry + "\n", encoding="utf-8")
    run(raylift, "render", "--cameras", "overview.txt", "--geometry", f"mesh:{demo / 'scene.obj'}", "--products",
        "color", "--format", "color=jpg", "--supersampling", 2, "--background", "255,255,255", "--out", "overview")
    [overview_file] = Path("overview").rglob("*.jpg")

    pose = poses[QUERY]
    lifted = [(pixel_and_point, reference) for pixel_and_point, reference in
              zip(problem["matches_2d3d"], problem["matches_2d3d_reference"]) if reference is not None]
    pixels = {}
    for reference, *of_both in problem["matches_2d2d"]:
        pixels.setdefault((reference, *of_both[:2]), of_both[2:])
    # Of the reference with most of them, those that the pose agrees with, spread over the photograph.
    chosen = statistics.mode(reference for _, reference in lifted)
    f, cx, cy, k = problem["query"]["camera"]["params"]

    def error(row):
        x, y, z = to_camera(pose, row[2:])
        u, v = x / z, y / z
        bent = 1 + k * (u * u + v * v)
        return math.hypot(f * u * bent + cx - row[0], f * v * bent + cy - row[1]) if z > 0 else math.inf

    right = [row for row, reference in lifted if reference == chosen and error(row) < 2]
    random.Random(4).shuffle(right)
    shown = []
    for row in right:
        if all(math.dist(row[:2], other[:2]) > 90 for other in shown):
            shown.append(row)
    shown = shown[:7]

    image = problem["references"][chosen]
    reference_pose = pose_of(image["cam_from_world"])

    def show(point):
        x, y, z = to_camera(overview, point)
        return (300 + OVERVIEW_FOCAL * x / z + OVERVIEW_WIDTH / 2, OVERVIEW_FOCAL * y / z + OVERVIEW_HEIGHT / 2)

    def in_picture(pixel, x, y):
        return x + pixel[0] * 280 / 640, y + pixel[1] * 210 / 480

    parts = [picture(jpeg(demo / "images" / image["name"]), 0, 0, 280, 210),
             picture(jpeg(demo / "images" / QUERY), 0, 210, 280, 210),
             picture(jpeg(overview_file), 300, 0, OVERVIEW_WIDTH, OVERVIEW_HEIGHT)]
    for i, row in enumerate(shown):
        width = 2.5 if i == 0 else 1
        of_reference = in_picture(pixels[chosen, row[0], row[1]], 0, 0)
        of_query = in_picture(row[:2], 0, 210)
        point = show(row[2:])
        parts += [line(of_reference, of_query, ORANGE, width),
                  line(show(to_world(reference_pose, (0, 0, 0))), point, BLUE, width),
                  line(point, show(to_world(pose, (0, 0, 0))), GREEN, width, "5 4"),
                  *(dot(at, ORANGE) for at in (of_reference, of_query, point))]
    parts += draw_camera(show, reference_pose, BLUE) + draw_camera(show, pose, GREEN)
    shadow = 'font-weight="bold" stroke="white" stroke-width="3" paint-order="stroke"'
    parts += [text((8, 202), "reference", color=BLUE, more=shadow), text((8, 412), "query", color=GREEN, more=shadow)]
    return svg(300 + OVERVIEW_WIDTH, OVERVIEW_HEIGHT, parts)


class Axes:
    """A diagram of 560 x 300 with its two axes."""

    def __init__(self, x_of, y_of, x_ticks, y_ticks, x_label, y_label):
        self.at = lambda x, y: (60 + 480 * x_of(x), 250 - 225 * y_of(y))
        left, bottom = 60, 250
        self.parts = [line((left, bottom), (left + 480, bottom), "black"), line((left, bottom), (left, 25), "black"),
                      text((left + 240, 292), x_label, "middle"),
                      text((18, 138), y_label, "middle", more='transform="rotate(-90 18 138)"')]
        for tick in x_ticks:
            x = left + 480 * x_of(tick)
            self.parts += [line((x, bottom), (x, bottom + 5), "black"), text((x, bottom + 21), f"{tick:g}", "middle")]
        for tick in y_ticks:
            y = bottom - 225 * y_of(tick)
            self.parts += [line((left - 5, y), (left + 480, y), "#dddddd", 1),
                           text((left - 9, y + 5), f"{tick:g}", "end")]


def thinned(problem, count, name, rng):
    """The problem with `count` of its keypoints."""
    keypoints = sorted({tuple(row[1:3]) for row in problem["matches_2d2d"]})
    kept = set(rng.sample(keypoints, count))
    points = [(row, reference) for row, reference in zip(problem["matches_2d3d"], problem["matches_2d3d_reference"])
              if tuple(row[:2]) in kept]
    return {"format": problem["format"], "name": name, "query": problem["query"], "references": problem["references"],
            "matches_2d2d": [row for row in problem["matches_2d2d"] if tuple(row[1:3]) in kept],
            "matches_2d3d": [row for row, _ in points], "matches_2d3d_reference": [r for _, r in points]}


def verdicts(raylift, problem, truth):
    """What becomes of the confidence where ever fewer of a query's keypoints are left."""
    folder = Path("thinned")
    folder.mkdir()
    counts = {}
    for i in range(160):
        name = f"{i:03}.jpg"
        counts[name] = round(4 * (MOST_LEFT / 4) ** (i / 159))
        few = thinned(problem, counts[name], name, random.Random(i))
        (folder / f"{i:03}.json").write_text(json.dumps(few), encoding="utf-8")
    run(raylift, "estimate", folder, "--scene-calibration", "demo/scene_calibration.json", "--json", "thinned.json",
        "--quiet")
    rows = json.loads(Path("thinned.json").read_text(encoding="utf-8"))
    axes = Axes(lambda n: math.log(n / 4) / math.log(MOST_LEFT / 4), lambda p: p, [4, 5, 7, 10, 15, 20, 30, 40],
                [0, 0.25, 0.5, 0.75, 0.95], "keypoints of the query that are left", "confidence")
    center = to_world(truth, (0, 0, 0))
    colors = {"localized": GREEN, "doubtful": ORANGE, "failed": GRAY}
    for row in rows:
        is_right = "qvec" in row and math.dist(to_world(pose_of(row), (0, 0, 0)), center) < 0.25
        at = axes.at(counts[row["name"]], row["confidence"])
        axes.parts.append(dot(at, colors[row["verdict"]], 5, 0.8) if is_right else
                          text((at[0], at[1] + 5), "&#215;", "middle", colors[row["verdict"]], 'font-size="20"'))
    for i, (name, color) in enumerate(colors.items()):
        axes.parts += [dot((380, 150 + 20 * i), color, 5), text((392, 155 + 20 * i), name)]
    axes.parts.append(text((374, 215), "&#215;  no pose within 0.25 m"))
    return svg(560, 300, axes.parts)


def read_npy(file):
    """The floats of an array."""
    data = file.read_bytes()
    values = array.array("f")
    values.frombytes(data[10 + int.from_bytes(data[8:10], "little"):])
    return values


def calibration(raylift, demo):
    """The factor that was planted in each reference's depth, and the one that was found."""
    scene = ["--model", demo / "model", "--images", demo / "images"]
    for out, planted in (("exact", []), ("network", ["--scale-sigma", 0.25, "--relative-noise", 0.01])):
        run(raylift, "perturb", "--model", demo / "model", "--geometry", f"mesh:{demo / 'scene.obj'}", "--out", out,
            *planted, "--quiet")
    run(raylift, "calibrate", *scene, "--geometry", "depth:network", "--queries",
        demo / "queries.txt", "--cache", "demo/cache", "--out", "calibration.json", "--quiet")
    [alignment] = json.loads(Path("calibration.json").read_text(encoding="utf-8"))["depth"]
    ticks = [0.5, 0.75, 1, 1.25, 1.5]
    axes = Axes(lambda x: (x - 0.4) / 1.4, lambda y: (y - 0.4) / 1.4, ticks, ticks,
                "what a reference's depth was multiplied by", "1 / the factor that was found")
    axes.parts.append(line(axes.at(0.4, 0.4), axes.at(1.8, 1.8), GRAY, 1, "4 4"))
    for found in alignment["maps"]:
        stem = Path(found["reference"]).with_suffix(".npy")
        pairs = zip(read_npy("network" / stem)[::97], read_npy("exact" / stem)[::97])
        ratios = [planted / exact for planted, exact in pairs if planted > 0 and exact > 0]
        correction = statistics.fmean(found["log_factors"])
        axes.parts.append(dot(axes.at(statistics.median(ratios), math.exp(-correction)), BLUE, 5, 0.8))
    return svg(560, 300, axes.parts)


def first_strip(page):
    """Of the first reference on the page of compare: photograph, depth by both sources, errors of the second."""
    found = re.findall(r'"(data:image/jpeg;base64,[A-Za-z0-9+/=]+)"', page.read_text(encoding="utf-8"))[:4]
    return svg(880, 165, [picture(data, 220 * i, 0, 219, 165) for i, data in enumerate(found)])


def gallery(raylift, demo, out):
    mesh = f"mesh:{demo / 'scene.obj'}"
    scene = ["--model", demo / "model", "--images", demo / "images"]
    run(raylift, "perturb", "--model", demo / "model", "--geometry", mesh, "--out", "scaled", "--scale", 1.1,
        "--warp", 0.02, "--quiet")
    run(raylift, "compare", *scene, "--geometry", f"mesh={mesh}", "--geometry", "scaled=depth:scaled", "--truth",
        "mesh", "--max-side", 320, "--out", "comparison", "--report", out / "compare", "--quiet")
    run(raylift, "render", "--model", demo / "model", "--geometry", mesh, "--every", 4, "--scale", 0.5, "--products",
        "depth,normals,color", "--out", "rendered", "--report", out / "render", "--preview", "--quiet")
    run(raylift, "evaluate", "--ground-truth", demo / "ground_truth", "--poses", "demo/poses.txt", "p3p.txt",
        "--names", "Adaptive", "P3P", "--thresholds", "0.05,0.5:0.1,1:0.25,2", "--report", out / "evaluate", "--quiet")
    shutil.rmtree(out / "localize/queries")  # what the page was made of
    shutil.copy("rendered/preview.png", out / "render.png")
    shutil.copy(next(Path("demo/pictures").rglob("*.jpg")), out / "localize.jpg")
    (out / "compare.svg").write_text(first_strip(out / "compare/index.html"), encoding="utf-8")


def main():
    raylift, demo, pages = (Path(word).resolve() for word in sys.argv[1:4])
    drawn, shown = pages / "pictures", pages / "gallery"
    shown.mkdir()
    run(raylift, "localize", "--scene", demo / "scene.toml", "--out", "demo", "--write-problems", "problems",
        "--report", shown / "localize", "--ground-truth", demo / "ground_truth", "--pictures", 2, "--quiet")
    run(raylift, "estimate", "problems", "--method", "p3p", "--poses", "p3p.txt", "--quiet")
    problems = (json.loads(file.read_text(encoding="utf-8")) for file in sorted(Path("problems").rglob("*.json")))
    problem = next(one for one in problems if one["name"] == QUERY)
    poses = read_poses(Path("demo/poses.txt"))
    (drawn / "lifting.svg").write_text(lifting(raylift, demo, problem, poses), encoding="utf-8")
    (drawn / "verdicts.svg").write_text(verdicts(raylift, problem, poses[QUERY]), encoding="utf-8")
    (drawn / "calibration.svg").write_text(calibration(raylift, demo), encoding="utf-8")
    gallery(raylift, demo, shown)


if __name__ == "__main__":
    main()
