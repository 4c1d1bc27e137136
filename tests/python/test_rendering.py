import itertools
import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import raylift
from synthetic import CAMERA, pose, resident_kb, some

DEMO = Path(os.environ["RAYLIFT_SOURCE"]) / "assets/demo"
MESH = f"mesh:{DEMO / 'scene.obj'}"
CORNERS = np.array(list(itertools.product([-1, 1], repeat=3)), float)
FACES = np.array([[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1],
                  [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]])
PINHOLE = raylift.Camera("SIMPLE_PINHOLE", 64, 48, [60, 32, 24])
FRONT = pose([0, 0, 0], [0, 0, -4])  # before the face z = -1, which is then at the depth 3


@pytest.fixture(scope="module")
def caster() -> raylift.RayCaster:
    return raylift.RayCaster(raylift.Mesh(CORNERS, FACES))


def test_mesh_from_arrays() -> None:
    colors = np.arange(24).reshape(8, 3).astype(np.uint8)
    mesh = raylift.Mesh(CORNERS + [1e6, 0, 0], FACES.astype(np.int32), colors)
    assert mesh.vertices[mesh.triangles].reshape(-1, 3) == pytest.approx(
        (CORNERS + [1e6, 0, 0])[FACES].reshape(-1, 3))
    assert (some(mesh.colors)[mesh.triangles] == colors[FACES]).all()
    assert not mesh.has_texture and mesh.warnings == []
    assert mesh.triangles.dtype == np.uint32 and not mesh.triangles.flags.writeable
    assert "12 triangles" in repr(mesh)
    assert raylift.Mesh(CORNERS, FACES).colors is None


@pytest.mark.parametrize("arguments, message", [
    ((CORNERS, FACES + 1), "triangle 2: expected indices into 8 vertices, found 8"),
    ((CORNERS, -FACES), "expected indices"),
    ((CORNERS[:, :2], FACES), r"vertices: expected an array of shape \(N, 3\)"),
    ((CORNERS, FACES, np.zeros((3, 3))), "expected a color for each of 8 vertices, found 3"),
    ((CORNERS, np.zeros((1, 3))), "mesh"),
])
def test_wrong_meshes_are_input_errors(arguments: tuple[Any, ...], message: str) -> None:
    with pytest.raises(raylift.InputError, match=message):
        raylift.Mesh(*arguments)


def test_mesh_from_files(tmp_path: Path) -> None:
    mesh = raylift.Mesh.read(DEMO / "scene.obj")
    assert mesh.has_texture and len(mesh.triangles) > 1000
    doubled = raylift.Mesh.read(f"mesh:{DEMO / 'scene.obj'},scale=2")
    assert doubled.vertices == pytest.approx(2 * mesh.vertices, abs=1e-5)
    with pytest.raises(raylift.InputError, match="missing.ply"):
        raylift.Mesh.read(tmp_path / "missing.ply")


def test_cast(caster: raylift.RayCaster) -> None:
    hits = caster.cast([[0, 0, -4], [0, 0, 4], [5, 5, 5]], [[0.0, 0, 2], [0.1, 0, -1], [1.0, 0, 0]])
    assert hits["ray_t"][:2] == pytest.approx([1.5, 3]) and np.isnan(hits["ray_t"][2])
    assert hits["points"][:2] == pytest.approx(np.array([[0, 0, -1], [0.3, 0, 1]]))
    assert np.abs(hits["normals"][:2]) == pytest.approx(np.array([[0, 0, 1], [0, 0, 1]]))
    assert hits["triangles"][2] == -1
    corners = caster.mesh.vertices[caster.mesh.triangles[hits["triangles"][1]]]
    u, v = hits["barycentric"][1]
    assert (1 - u - v) * corners[0] + u * corners[1] + v * corners[2] == pytest.approx([0.3, 0, 1])
    from_one = caster.cast([[0, 0, -4]], np.random.default_rng(0).normal(size=(10000, 3)), threads=2)
    assert from_one["ray_t"].shape == (10000,)
    assert caster.occluded([[0, 0, -4]], [[0, 0, 1], [0, 0, -1]]).tolist() == [True, False]
    assert not caster.occluded([[0, 0, -4]], [[0, 0, 1]], t_near=6)[0]
    with pytest.raises(raylift.InputError, match="origins and directions"):
        caster.cast(np.zeros((2, 3)), np.zeros((3, 3)))


def test_render_gives_what_the_camera_sees(caster: raylift.RayCaster) -> None:
    products = ["depth", "distance", "normals", "color", "triangle", "incidence", "mask"]
    maps = caster.render(PINHOLE, FRONT, products)
    assert list(maps) == products
    arrays: dict[str, Any] = {**maps}
    for name, dtype in [("depth", "f4"), ("distance", "f4"), ("triangle", "u4"), ("incidence", "f4"),
                        ("mask", "u1")]:
        assert arrays[name].shape == (48, 64) and arrays[name].dtype == np.dtype(dtype)
    assert maps["normals"].shape == maps["color"].shape == (48, 64, 3)
    # The face spans 60 * 1 / 3 = 20 pixels on each side of the center.
    seen = maps["mask"] == 255
    assert seen.sum() == 40 * 40 and seen[4:44, 12:52].all()
    assert maps["depth"][seen] == pytest.approx(3, abs=1e-5)
    x = (np.arange(64) + 0.5 - 32) / 60
    assert maps["distance"][24, 12:52] == pytest.approx(
        3 * np.sqrt(1 + x[12:52] ** 2 + (0.5 / 60) ** 2), rel=1e-5)
    assert maps["normals"][24, 32] == pytest.approx([0, 0, -1])
    assert maps["incidence"][24, 32] < 1 and maps["incidence"][0, 0] == -1
    assert maps["depth"][0, 0] == 0 and maps["triangle"][0, 0] == 2**32 - 1
    in_camera = caster.render(PINHOLE, pose([0, np.pi, 0], [0, 0, 4]), ["normals"], normals_in="camera")
    assert in_camera["normals"][24, 32] == pytest.approx([0, 0, -1], abs=1e-6)
    white = caster.render(PINHOLE, FRONT, ["color"], background=(1, 2, 3), shading="headlight",
                          supersampling=2)["color"]
    assert white[0, 0].tolist() == [1, 2, 3] and white[24, 32].max() > 100


def test_render_of_a_distorted_lens_follows_its_rays(caster: raylift.RayCaster) -> None:
    depth = caster.render(CAMERA, FRONT)["depth"]
    rows, columns = np.nonzero(depth)
    pixels = np.column_stack([columns, rows]) + 0.5
    rays = CAMERA.rays(pixels)
    hits = caster.cast([[0, 0, -4]], rays)
    assert depth[rows, columns] == pytest.approx(hits["ray_t"] * rays[:, 2], rel=1e-5)


def test_render_of_a_panorama_sees_all_around(caster: raylift.RayCaster) -> None:
    panorama = raylift.Camera("EQUIRECTANGULAR", 64, 32, [64, 32])
    maps = caster.render(panorama, raylift.Rigid3(), ["depth", "mask"])  # from within the cube
    assert (maps["mask"] == 255).all()
    assert 1 <= maps["depth"].min() < 1.01 and 1.6 < maps["depth"].max() <= 3 ** 0.5


@pytest.mark.parametrize("keywords, message", [
    (dict(products=["deep"]), "products = deep: expected depth"),
    (dict(shading="dark"), "shading = dark"),
    (dict(supersampling=0), "supersampling = 0: must be 1 to 16"),
    (dict(sharpness=1), "sharpness: there is no such option"),
])
def test_wrong_options_of_render(caster: raylift.RayCaster, keywords: dict[str, Any],
                                 message: str) -> None:
    with pytest.raises(raylift.OptionError, match=message):
        caster.render(PINHOLE, FRONT, **keywords)


def test_many_views_equal_single_ones(caster: raylift.RayCaster) -> None:
    poses = [pose([0.1 * i, 0.05 * i, 0], [0.1 * i, 0, -4]) for i in range(20)]
    told = []
    many = caster.render_many(PINHOLE, poses, ["depth", "mask"], threads=2,
                              progress=lambda *a: told.append(a))
    assert told[-1] == (20, 20, "images")
    cameras = [PINHOLE] * 19 + [CAMERA]
    mixed = caster.render_many(cameras, poses)
    for i in range(20):
        alone = caster.render(cameras[i], poses[i])
        assert (mixed[i]["depth"] == alone["depth"]).all()
        if i < 19:
            assert (many[i]["depth"] == alone["depth"]).all()
    with pytest.raises(raylift.InputError, match="cameras and poses"):
        caster.render_many([PINHOLE], poses)


def test_the_right_view_scores_best(caster: raylift.RayCaster) -> None:
    rng = np.random.default_rng(0)
    truth = pose([0.2, 0.3, 0.1], [0.9, -0.6, -4])
    poses = [truth] + [pose(rng.normal(0, 0.2, 3), rng.normal(0, 0.3, 3) + [0.9, -0.6, -4])
                       for _ in range(50)]
    maps = caster.render(PINHOLE, truth, ["depth", "mask"])
    mask = maps["mask"] > 0
    # 1 on the outline of the mask.
    edges = (mask & ~(np.roll(mask, 1, 0) & np.roll(mask, -1, 0) & np.roll(mask, 1, 1) &
                      np.roll(mask, -1, 1))).astype(float)
    scores = caster.score_views(PINHOLE, poses, mask=mask, depth=maps["depth"], edges=edges, threads=2)
    assert set(scores) == {"mask", "depth", "edges"}
    several: dict[str, Any] = {**scores}
    for name, score in several.items():
        assert score.shape == (51,) and score.argmax() == 0, name
        assert score[0] == pytest.approx(1)
    assert set(caster.score_views(PINHOLE, poses, mask=mask)) == {"mask"}
    union = mask | (caster.render(PINHOLE, poses[1], ["mask"])["mask"] > 0)
    both = mask & (caster.render(PINHOLE, poses[1], ["mask"])["mask"] > 0)
    assert scores["mask"][1] == pytest.approx(both.sum() / union.sum())
    with pytest.raises(raylift.OptionError, match="at least one"):
        caster.score_views(PINHOLE, poses)
    with pytest.raises(raylift.InputError, match=r"mask: expected an array of shape \(48, 64\)"):
        caster.score_views(PINHOLE, poses, mask=mask[1:])


def test_maps_cross_without_a_copy(caster: raylift.RayCaster) -> None:
    camera = raylift.Camera("SIMPLE_PINHOLE", 1920, 1080, [1500, 960, 540])
    depth = caster.render(camera, FRONT)["depth"]
    # The memory is the renderer's: the array owns none, but keeps what does.
    assert not depth.flags.owndata and depth.base is not None
    assert depth.flags.c_contiguous and depth.flags.writeable

    # Its 8 MB are there once, and are given back.
    maps = [caster.render(camera, FRONT)["depth"] for _ in range(3)]
    before = resident_kb()
    more = [caster.render(camera, FRONT)["depth"] for _ in range(20)]
    held = resident_kb() - before
    assert held < 20 * 1920 * 1080 * 4 / 1024 * 1.2
    del maps, more, depth


def test_no_memory_is_lost(caster: raylift.RayCaster) -> None:
    for _ in range(200):
        caster.render(PINHOLE, FRONT, ["depth", "normals", "color"])
    before = resident_kb()
    for _ in range(10000):
        caster.render(PINHOLE, FRONT, ["depth", "normals", "color"], threads=1)
    # 10000 depth maps alone are 120 MB.
    assert resident_kb() - before < 4000


def wall_points(step: float = 0.02) -> NDArray[np.float64]:
    x, y = np.meshgrid(np.arange(-1, 1, step), np.arange(-1, 1, step))
    return np.stack([x.ravel(), y.ravel(), np.full(x.size, 5.0)], axis=1).astype(float)


def test_rays_at_points_and_splats_in_memory(tmp_path: Path) -> None:
    points = wall_points()
    colors = np.full(points.shape, 200, np.uint8)
    cloud = raylift.RayCaster.of_points(points, normals=np.tile([0, 0, -2.0], (len(points), 1)), colors=colors)
    splats = raylift.RayCaster.of_splats(points, np.tile([1.0, 0, 0, 0], (len(points), 1)),
                                         np.tile([0.02, 0.02, 1e-4], (len(points), 1)), np.full(len(points), 0.9),
                                         colors / 255)
    rows = "\n".join(" ".join(map(str, point)) for point in points)
    (tmp_path / "wall.xyz").write_text(rows)
    read = raylift.RayCaster(f"cloud:{tmp_path / 'wall.xyz'}")
    directions = [[0.01, 0.02, 1], [0.05, -0.1, 1], [0.0, 0, -1]]
    for caster in cloud, splats, read:
        hits = caster.cast([[0, 0, 0]], directions)
        assert hits["ray_t"][:2] == pytest.approx(5, abs=1e-3) and np.isnan(hits["ray_t"][2])
    camera = raylift.Camera("PINHOLE", 32, 32, [200, 200, 16, 16])
    for caster in cloud, splats:
        maps = caster.render(camera, raylift.Rigid3(), ["depth", "color"])
        assert maps["depth"][8:24, 8:24] == pytest.approx(5, abs=0.01)
        assert np.abs(maps["color"][8:24, 8:24].astype(int) - 200).max() < 12
    assert "discs" in repr(cloud) and "splats" in repr(splats) and cloud._repr_png_() is None
    scene = raylift.Scene.of([raylift.PosedImage("a.jpg", camera, raylift.Rigid3())], [cloud])
    assert scene.geometry[0].lift(scene.references[0], [[16, 16]])["points"][0] == pytest.approx([0, 0, 5], abs=1e-3)


@pytest.mark.parametrize("wrong, message", [
    (dict(normals=[[0, 0, 0]] * 3), "normals: expected directions"),
    (dict(colors=[[1, 2, 3]]), "colors: expected 3 rows, found 1"),
])
def test_wrong_clouds_are_input_errors(wrong: dict[str, Any], message: str) -> None:
    with pytest.raises(raylift.InputError, match=message):
        raylift.RayCaster.of_points(np.eye(3), **wrong)
    with pytest.raises(raylift.InputError, match="row 0: expected finite numbers, a rotation"):
        raylift.RayCaster.of_splats([[0, 0, 0]], [[0, 0, 0, 0]], [[1, 1, 1]], [1])


def test_views_are_placed_on_a_mesh() -> None:
    caster = raylift.Scene(DEMO / "model", [MESH]).mesh
    camera = raylift.Camera("PINHOLE", 64, 48, [50, 50, 32, 24])
    for how in "around", "inside", "cover", "walk":
        poses = caster.sample_views(camera, 6, how=how)
        assert 0 < len(poses) <= 6 and poses == caster.sample_views(camera, 6, how=how, threads=1)
        assert all((maps["depth"] > 0).mean() > 0.05 for maps in caster.render_many(camera, poses))
    with pytest.raises(raylift.OptionError, match=r"how = above: expected around\|inside\|cover\|walk"):
        caster.sample_views(camera, how="above")


def test_rays_of_a_picture_hit_as_single_ones_do() -> None:
    scene = raylift.Scene(DEMO / "model", [MESH])
    view = scene.references[0]
    pixels = np.stack(np.meshgrid(np.arange(320) * 2 + 0.5, np.arange(60) * 8 + 0.5), axis=-1).reshape(-1, 2)
    directions = view.camera.rays(pixels) @ view.cam_from_world.rotation
    origin = view.cam_from_world.center[None]
    directions[7] = np.nan
    single = scene.mesh.cast(origin, directions, t_near=1e-9)
    order = np.random.default_rng(0).permutation(len(pixels))  # neighbors do not run together
    shuffled = scene.mesh.cast(origin, directions[order])
    for hits, rows in (scene.mesh.cast(origin, directions), np.arange(len(order))), (shuffled, order):
        same = hits["triangles"] == single["triangles"][rows]
        assert same.mean() > 0.999 and (hits["triangles"] >= 0).mean() > 0.9
        assert hits["ray_t"][same] == pytest.approx(single["ray_t"][rows][same], rel=1e-9, nan_ok=True)
        assert hits["points"][same] == pytest.approx(single["points"][rows][same], rel=1e-9, nan_ok=True)
    for threads in 1, 3:
        again = scene.mesh.cast(np.tile(origin, (len(order), 1)), directions[order], threads=threads)
        assert np.array_equal(again["triangles"], shuffled["triangles"])
        assert np.array_equal(again["ray_t"], shuffled["ray_t"], equal_nan=True)
        assert np.array_equal(again["points"], shuffled["points"], equal_nan=True)
        assert np.array_equal(again["normals"], shuffled["normals"], equal_nan=True)
        assert np.array_equal(again["barycentric"], shuffled["barycentric"], equal_nan=True)


@pytest.mark.parametrize("length", [1e-24, 1e-6, 1e6, 1e20])
def test_rays_of_a_picture_hit_whatever_their_length(length: float) -> None:
    scene = raylift.Scene(DEMO / "model", [MESH])
    view = scene.references[0]
    pixels = np.stack(np.meshgrid(np.arange(300, 332), np.arange(220, 228)), axis=-1).reshape(-1, 2)
    directions = view.camera.rays(pixels) @ view.cam_from_world.rotation
    origin = view.cam_from_world.center[None]
    of_unit = scene.mesh.cast(origin, directions)
    hits = scene.mesh.cast(origin, length * directions)
    assert np.isfinite(of_unit["ray_t"]).all()
    np.testing.assert_allclose(hits["points"], of_unit["points"], atol=1e-9)
    np.testing.assert_allclose(length * hits["ray_t"], of_unit["ray_t"], rtol=1e-6)


def test_a_cloud_in_memory_is_no_mesh_of_a_scene() -> None:
    cloud = raylift.RayCaster.of_points(wall_points(0.1))
    assert raylift.Scene(DEMO / "model", [cloud]).mesh is None
    assert raylift.Geometry(cloud).description == "cloud from memory"


def test_colors_are_bytes_of_any_type() -> None:
    for colors in np.array([[0, 1, 255]] * 3), np.array([[0.0, 1, 255]] * 3), [[0, 1, 255]] * 3, np.zeros((3, 3)):
        mesh = raylift.Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]], colors)
        assert some(mesh.colors).tolist() == np.asarray(colors).tolist()
    dark = raylift.Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]], [[0, 1, 1]] * 3)
    assert some(dark.colors).tolist() == [[0, 1, 1]] * 3
