"""Depth maps of a mesh for a COLMAP model's images: depth_maps.py [DEMO [OUT]]"""

import sys
from pathlib import Path

import raylift


def main(demo: Path, out: Path) -> None:
    # One view, in memory: the arrays are the renderer's own.
    caster = raylift.RayCaster(raylift.Mesh.read(demo / "scene.obj"))
    image = raylift.ColmapModel.read(demo / "model").posed_images[0]
    maps = caster.render(image.camera, image.cam_from_world, ["depth", "normals", "color"])
    depth = maps["depth"]
    print(f"{image.name}: depth {depth[depth > 0].min():.2f} to {depth.max():.2f}")

    # All of them, to files.
    summary = raylift.render_dataset(f"mesh:{demo / 'scene.obj'}", out, model=demo / "model",
                                     products=["depth", "color"], format="color=jpg", scale=0.25)
    print(f"{summary['images']} images in {out}")


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "assets/demo"),
         Path(sys.argv[2] if len(sys.argv) > 2 else "out/python_depth"))
