import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any, Callable

import numpy as np
import pytest
from numpy.typing import NDArray

import raylift
from scenes import DEMO, MESH, HlocScene, truth
from synthetic import pose, some


def test_evaluate(tmp_path: Path) -> None:
    poses = {name: image.cam_from_world for name, image in truth().items()}
    raylift.write_poses(tmp_path / "poses.txt", poses)
    moved = {name: raylift.Rigid3(p.rotation, p.tvec + [0.3, 0, 0]) for name, p in poses.items()}
    table = raylift.evaluate([tmp_path / "poses.txt", moved], DEMO / "ground_truth",
                             names=["right", "moved"], thresholds=[(0.1, 1), (0.5, 1)])
    rows = table["results"]
    assert [row["name"] for row in rows] == ["right", "moved"]
    assert rows[0]["recalls_percent"] == [100, 100] and rows[1]["recalls_percent"] == [0, 100]
    assert rows[1]["median_position"] == pytest.approx(0.3)
    alone = raylift.evaluate(moved, poses, names=["moved"], thresholds="0.1,1:0.5,1", groups=None)
    assert alone["results"][0]["median_position"] == pytest.approx(0.3)


def test_render_perturb_and_compare(tmp_path: Path) -> None:
    told = []
    summary = raylift.render_dataset(MESH, tmp_path / "maps", model=DEMO / "model", scale=0.1, every=4,
                                     products=["depth", "mask"], format=["depth=npy"], threads=2,
                                     progress=lambda *a: told.append(a))
    assert summary["images"] == told[-1][0] == told[-1][1] and told[-1][2] == "images"
    images = raylift.Scene(DEMO / "model", every=4).references
    depth = raylift.DepthMaps(tmp_path / "maps/depth", images).load(images[0])
    camera = images[0].camera.scaled(some(depth).shape[1], some(depth).shape[0])
    caster = raylift.RayCaster(raylift.Mesh.read(DEMO / "scene.obj"))
    assert depth == pytest.approx(caster.render(camera, images[0].cam_from_world)["depth"], abs=1e-6)

    raylift.run("perturb", model=DEMO / "model", geometry=MESH, out=tmp_path / "scaled", scale=1.1, every=4)
    result = raylift.compare(DEMO / "model", {"mesh": MESH, "scaled": f"depth:{tmp_path / 'scaled'}"},
                             truth="mesh", every=4, max_side=100)
    assert result["localization"] is None
    scaled = [s for s in result["depth"]["sources"] if s["name"] == "scaled"][0]
    assert scaled["means"]["abs_rel"] == pytest.approx(0.1, abs=0.01)
    assert scaled["scale_percent"] == pytest.approx(10, abs=1)


def read_cloud(file: Path) -> NDArray[np.void]:
    header, rows = file.read_bytes().split(b"end_header\n", 1)
    types = {"double": "<f8", "float": "<f4", "uchar": "u1"}
    properties = [line.split()[1:] for line in header.decode().splitlines() if line.startswith("property")]
    return np.frombuffer(rows, [(name, types[kind]) for kind, name in properties])


def test_cubemaps_with_clouds_and_transforms(tmp_path: Path) -> None:
    cv2 = pytest.importorskip("cv2")
    raylift.run("render", geometry=MESH, model=DEMO / "model", out=tmp_path, glob="ref/ref_0*", every=4,
                cubemap=48, products="depth,color,normals,points", format=["points=ply"],
                camera_files="transforms")
    images = {image.name: image for image in raylift.ColmapModel.read(DEMO / "model").posed_images}
    frames = json.loads((tmp_path / "transforms.json").read_text())["frames"]
    assert {Path(frame["file_path"]).stem for frame in frames} == {"front", "right", "back", "left", "up", "down"}
    columns, rows = np.meshgrid(np.arange(48) + 0.5, np.arange(48) + 0.5)
    for frame in frames:
        depth = np.load(tmp_path / frame["depth_file_path"]).astype(float)
        assert (frame["fl_x"], frame["fl_y"], frame["cx"], frame["cy"]) == (24, 24, 24, 24)
        # nerfstudio's cameras look along -z, with y up.
        rays = np.stack([(columns - frame["cx"]) / frame["fl_x"], -(rows - frame["cy"]) / frame["fl_y"],
                         -np.ones_like(columns)], axis=-1)
        matrix = np.array(frame["transform_matrix"])
        seen = depth > 0
        points = (depth[..., None] * rays)[seen] @ matrix[:3, :3].T + matrix[:3, 3]
        stem = Path(frame["file_path"]).relative_to("color").with_suffix("")
        cloud = read_cloud(tmp_path / "points" / f"{stem}.ply")
        assert len(cloud) == seen.sum()
        assert np.stack([cloud[name] for name in "xyz"], -1) == pytest.approx(points, abs=1e-5)
        normals = np.load(tmp_path / "normals" / f"{stem}.npy")[seen]
        assert (np.stack([cloud[name] for name in ("nx", "ny", "nz")], -1) == normals).all()
        color = cv2.imread(str(tmp_path / frame["file_path"]))[seen]
        assert (np.stack([cloud[name] for name in ("blue", "green", "red")], -1) == color).all()
        image = next(i for n, i in images.items() if Path(n).with_suffix("") == stem.parent)
        assert matrix[:3, 3] == pytest.approx(image.cam_from_world.center)
        if stem.name == "front":
            turned = image.cam_from_world.matrix[:3, :3].T @ np.diag([1, -1, -1])
            assert matrix[:3, :3] == pytest.approx(turned, abs=1e-12)


def read_pfm(file: Path) -> NDArray[np.float32]:
    """As MVSNet's readers do: the lowest row is the first."""
    kind, size, scale, values = file.read_bytes().split(b"\n", 3)
    assert kind == b"Pf" and float(scale) < 0
    width, height = map(int, size.split())
    return np.frombuffer(values, "<f4").reshape(height, width)[::-1]


def test_mvsnet_has_cameras_and_pairs(tmp_path: Path) -> None:
    raylift.run("render", geometry=MESH, model=DEMO / "model", out=tmp_path, glob="ref/ref_0*",
                products="depth", format="depth=pfm", pattern="{index}", camera_files="mvsnet")
    images = [image for image in raylift.ColmapModel.read(DEMO / "model").posed_images
              if image.name.startswith("ref/ref_0")]
    images.sort(key=lambda image: image.name)
    depths, cameras = [], []
    for i, image in enumerate(images):
        lines = (tmp_path / f"cams/{i:08d}_cam.txt").read_text().splitlines()
        extrinsic = np.array([line.split() for line in lines[1:5]], float)
        intrinsic = np.array([line.split() for line in lines[7:10]], float)
        low, interval, number, high = map(float, lines[11].split())
        assert lines[0] == "extrinsic" and lines[6] == "intrinsic"
        assert extrinsic[:3] == pytest.approx(image.cam_from_world.matrix[:3])
        fx, fy, cx, cy = image.camera.params
        assert intrinsic == pytest.approx(np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]]))
        depths.append(read_pfm(tmp_path / f"depth/{i:08d}.pfm"))
        assert low + (number - 1) * interval == pytest.approx(high)
        seen = depths[-1][depths[-1] > 0]
        assert ((seen >= 0.95 * low) & (seen <= 1.05 * high)).mean() > 0.95
        cameras.append((extrinsic, intrinsic))
    pairs = (tmp_path / "pair.txt").read_text().split("\n")
    assert int(pairs[0]) == len(images)
    for i in range(len(images)):
        assert int(pairs[1 + 2 * i]) == i
        count, *rest = pairs[2 + 2 * i].split()
        sources, scores = np.array(rest[::2], int), np.array(rest[1::2], float)
        assert int(count) == len(sources) > 2 and i not in sources
        assert (np.diff(scores) <= 0).all()
        # The depth of a view, seen from its best source, is what that one sees of most of it.
        y, x = np.mgrid[4:480:16, 4:640:16].reshape(2, -1)
        z = depths[i][y, x]
        (from_world, k), (to_world, to_k) = cameras[i], cameras[sources[0]]
        in_cam = np.linalg.inv(k) @ np.stack([(x + 0.5) * z, (y + 0.5) * z, z])
        in_other = to_world @ np.linalg.inv(from_world) @ np.vstack([in_cam, np.ones(len(x))])
        u, v, w = to_k @ in_other[:3]
        inside = (z > 0) & (w > 0) & (u > 0) & (u < 640 * w) & (v > 0) & (v < 480 * w)
        u, v = (u[inside] / w[inside]).astype(int), (v[inside] / w[inside]).astype(int)
        agrees = np.abs(depths[sources[0]][v, u] - w[inside]) < 0.02 * w[inside]
        assert agrees.sum() > 100
    with pytest.raises(raylift.InputError, match="mvsnet takes pinholes alone"):
        raylift.run("render", geometry=MESH, model=DEMO / "model", out=tmp_path / "all",
                    camera_files="mvsnet")


def test_transforms_has_depth_beside_pictures(tmp_path: Path) -> None:
    raylift.run("render", geometry=MESH, model=DEMO / "model", out=tmp_path / "out", every=4, scale=0.5,
                products="depth,color", format="depth=png", png_step=0.002, camera_files="transforms")
    file = tmp_path / "out/transforms.json"
    transforms = json.loads(file.read_text())
    assert transforms["depth_unit_scale_factor"] == 0.002
    images = {image.name: image for image in raylift.Scene(DEMO / "model", every=4).references}
    caster = raylift.RayCaster(raylift.Mesh.read(DEMO / "scene.obj"))
    assert len(transforms["frames"]) == len(images)
    for frame in transforms["frames"]:
        image = images[frame["file_path"].removeprefix("color/").replace(".png", ".jpg")]
        world_from_gl = np.array(frame["transform_matrix"])
        cam_from_world = np.linalg.inv(world_from_gl @ np.diag([1, -1, -1, 1]))
        assert cam_from_world[:3] == pytest.approx(image.cam_from_world.matrix[:3])
        camera = image.camera.scaled(frame["w"], frame["h"])
        assert (frame["w"], frame["fl_x"]) == (320, pytest.approx(camera.params[0]))
        assert frame.get("k1", 0) == (image.camera.params[3] if len(image.camera.params) == 4
                                      and image.camera.model == "SIMPLE_RADIAL" else 0)
        depth = raylift.DepthMaps(tmp_path / "out/depth", [image], unit=0.002).load(image)
        assert (tmp_path / "out" / frame["depth_file_path"]).exists()
        truth = caster.render(camera, image.cam_from_world)["depth"]
        assert depth == pytest.approx(truth, abs=0.0011)
    # What is written is what is read as cameras.
    again = raylift.render_dataset(MESH, tmp_path / "again", cameras=file, products=["depth"])
    assert again["images"] == len(images)
    with pytest.raises(raylift.InputError, match="needs depth as npy or png"):
        raylift.run("render", geometry=MESH, model=DEMO / "model", out=tmp_path / "exr",
                    products="depth,color", format="depth=exr", camera_files="transforms")


def test_color(tmp_path: Path) -> None:
    bare = tmp_path / "bare.obj"
    lines = (DEMO / "scene.obj").read_text().splitlines()
    bare.write_text("\n".join(line for line in lines if not line.startswith(("mtllib", "usemtl"))))
    assert raylift.Mesh.read(bare).colors is None
    told = []
    mesh = raylift.color(bare, tmp_path / "colored.ply", model=DEMO / "model", images=DEMO / "images",
                          max_edge=0.2, every=4, progress=lambda *a: told.append(a))
    assert told[-1] == (6, 6, "photographs")
    assert some(mesh.colors).shape == mesh.vertices.shape and len(np.unique(some(mesh.colors), axis=0)) > 100
    with pytest.raises(raylift.OptionError, match=r"out = .*expected a name that ends in .ply"):
        raylift.color(bare, tmp_path / "colored.obj", model=DEMO / "model", images=DEMO / "images")


def test_doctor(tmp_path: Path) -> None:
    diagnosis = raylift.doctor(DEMO / "model", f"{MESH},scale=1000", images=DEMO / "images", every=2,
                               max_features=1000)
    assert diagnosis["verdict"] == "repair" and "scale=1000" in diagnosis["summary"]


def test_localize_and_experiment(tmp_path: Path) -> None:
    hloc = HlocScene(tmp_path / "hloc")
    files = dict(features=hloc.features, matches=hloc.matches_file, pairs=hloc.pairs)
    summary = raylift.localize(tmp_path / "out", scene=DEMO / "scene.toml", queries=hloc.query_list,
                               method="p3p", images=None, query_images=None, **files)
    assert summary["queries"] == 4 and len(raylift.read_poses(tmp_path / "out/poses.txt")) == 4
    (tmp_path / "grid.toml").write_text(f"""
title = "Demo"
[scenes.demo]
model = "{DEMO / 'model'}"
queries = "{hloc.query_list}"
ground_truth = "${{TRUTH}}"
thresholds = "0.05,0.5"
features = "{hloc.features}"
matches = "{hloc.matches_file}"
pairs = "{hloc.pairs}"
[scenes.demo.geometry]
mesh = "{MESH}"
[[grid]]
method = ["p3p", "select"]
[[table]]
name = "methods"
title = "Methods"
rows = ["method"]
""")
    arguments = (tmp_path / "grid.toml", tmp_path / "experiment")
    raylift.write_poses(tmp_path / "truth.txt",
                        {name: hloc.truth[name].cam_from_world for name, _ in hloc.queries})
    variables = {"TRUTH": str(tmp_path / "truth.txt")}
    assert raylift.experiment(*arguments, set=variables, dry_run=True) == []
    rows = raylift.experiment(*arguments, set=variables)
    assert {row["method"] for row in rows} == {"p3p", "select"}
    assert (tmp_path / "experiment/tables/methods.md").exists()


def test_import(tmp_path: Path) -> None:
    folder = tmp_path / "scan"
    (folder / "images").mkdir(parents=True)
    image = raylift.read_image(DEMO / "images/query/query_02.jpg")
    import cv2

    frames = []
    for i in range(20):
        cv2.imwrite(str(folder / f"images/{i:02}.jpg"), image[..., ::-1])
        frames.append('{"file_path": "images/%02d.jpg", "transform_matrix": %s}'
                      % (i, pose([0, 0.1 * i, 0], [i, 0, 0]).inverse().matrix.tolist()))
    (folder / "transforms.json").write_text(
        '{"camera_model": "OPENCV", "fl_x": 488, "fl_y": 488, "cx": 320, "cy": 240, "w": 640, "h": 480, '
        '"frames": [%s]}' % ", ".join(frames))
    files = raylift.import_dataset("nerfstudio", folder, tmp_path / "scenes", query_every=5)
    assert [file.name for file in files] == ["scene.toml"]
    assert len(raylift.Scene.read(files[0], geometry=[]).references) in range(10, 20)


@pytest.mark.parametrize("call, message", [
    (lambda: raylift.run("localise"), "localise"),
    (lambda: raylift.evaluate("poses.txt", "truth", tresholds="1,2"), "tresholds"),  # type: ignore[call-arg]
    (lambda: raylift.render_dataset(MESH, "out", model="a", cameras="b"), "either model or cameras"),
    (lambda: raylift.localize("out", model="m", queries="q", method="p9p"), "p9p"),  # type: ignore[arg-type]
    (lambda: raylift.localize("out", model="m", queries="q", geometry="mesh:a", min_iterations=-3),
     "min_iterations = -3"),
    (lambda: raylift.import_dataset("9scenes", "a", "b"), "9scenes"),
])
def test_wrong_options_are_option_errors(call: Callable[..., Any], message: str) -> None:
    with pytest.raises(raylift.OptionError, match=message):
        call()


def test_wrong_input_is_an_input_error(tmp_path: Path) -> None:
    with pytest.raises(raylift.InputError, match="missing"):
        raylift.evaluate(tmp_path / "missing.txt", DEMO / "ground_truth")


def test_ctrl_c_ends_a_command(tmp_path: Path) -> None:
    script = f"""
import os, signal, threading
import raylift
signal.signal(signal.SIGINT, signal.default_int_handler)  # ignored in what runs in a shell's background
def interrupt(done, total, what):
    os.kill(os.getpid(), signal.SIGINT)
try:
    raylift.render_dataset("{MESH}", "{tmp_path}", model="{DEMO / 'model'}", products="depth,color",
                           supersampling=4, progress=interrupt, threads=1)
except KeyboardInterrupt:
    print("stopped", signal.getsignal(signal.SIGINT) is signal.default_int_handler)
"""
    run = subprocess.run([sys.executable, "-c", script], text=True, capture_output=True, timeout=100)
    assert run.stdout == "stopped True\n", run.stderr
    whole = raylift.render_dataset(MESH, tmp_path, model=DEMO / "model", products="depth,color",
                                   resume=True)
    assert whole["images"] == len(raylift.Scene(DEMO / "model").references)


def test_the_program(tmp_path: Path) -> None:
    def raylift_program(*arguments: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run([sys.executable, "-m", "raylift", *arguments], text=True,
                              capture_output=True)

    assert raylift_program("--version").stdout == f"raylift {raylift.__version__}\n"
    wrong = raylift_program("evaluate", "--poses", "missing.txt", "--ground-truth", "missing.txt")
    assert wrong.returncode == 3 and "missing.txt" in wrong.stderr


def test_tables_are_printed_when_a_command_has_ended() -> None:
    script = """
import os, sys, raylift
model = raylift.ColmapModel.read(sys.argv[1])
poses = {image.name: image.cam_from_world for image in model.posed_images}
raylift.evaluate(poses, sys.argv[1], quiet=False)
os._exit(0)
"""
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONUNBUFFERED"}
    run = subprocess.run([sys.executable, "-c", script, DEMO / "ground_truth"], text=True, capture_output=True,
                         check=True, env=environment)
    assert "100.0" in run.stdout


def test_options_are_also_numpys_numbers(tmp_path: Path) -> None:
    raylift.render_dataset(f"mesh:{DEMO / 'scene.obj'}", tmp_path, model=DEMO / "model", scale=np.float64(0.05),
                           every=np.int64(12))
    assert raylift.read_depth(next(tmp_path.rglob("*.npy"))).shape == (24, 32)


def test_help_is_no_error(capfd: pytest.CaptureFixture[str]) -> None:
    raylift.run("evaluate", "--help")
    assert "--thresholds" in capfd.readouterr().out


def test_colour_is_color() -> None:
    assert raylift.colour is raylift.color


def test_poses_are_exported(tmp_path: Path) -> None:
    poses = {name: image.cam_from_world for name, image in truth().items()}
    file = raylift.export("kitti", poses, tmp_path / "poses.kitti")
    assert file == tmp_path / "poses.kitti" and len(file.read_text().splitlines()) == len(poses)
    model = raylift.export("colmap", poses, tmp_path / "model", model=DEMO / "model", queries=DEMO / "queries.txt")
    assert poses.keys() <= {image.name for image in raylift.ColmapModel.read(model).posed_images}


def test_references_are_retrieved(tmp_path: Path) -> None:
    found = raylift.retrieve(tmp_path / "pairs.txt", model=DEMO / "model", retrieval="pose", top_k=3)
    names = [image.name for image in raylift.ColmapModel.read(DEMO / "model").posed_images]
    assert set(found) <= set(names) and all(0 < len(one) <= 3 and set(one) <= set(names) for one in found.values())


def test_a_report_that_there_is_not(tmp_path: Path) -> None:
    with pytest.raises(raylift.InputError, match="index.html: there is no such page"):
        raylift.Report(tmp_path / "index.html")
    with pytest.raises(TypeError, match=r"^path: expected a path \(str or os.PathLike\), found int$"):
        raylift.Report(5)  # type: ignore[arg-type]


def test_a_command_that_there_is_not() -> None:
    with pytest.raises(raylift.OptionError, match="not expected: localise; did you mean localize"):
        raylift.run("localise", model="x")
    raylift.run("localize", "--help")
