"""Where was a photograph taken? Against a mesh and reference photographs: localize_photograph.py [DEMO]"""

import sys
from pathlib import Path

import raylift


def main(demo: Path) -> None:
    scene = raylift.Scene(demo / "model", [f"mesh:{demo / 'scene.obj'}"], images=demo / "images")
    localizer = raylift.Localizer(scene)

    photograph = raylift.read_image(demo / "images/query/query_02.jpg")  # or any uint8 array, RGB
    height, width = photograph.shape[:2]
    camera = raylift.Camera("SIMPLE_RADIAL", width, height, [488, 323.1, 236.4, -0.11])
    query = localizer.localize(photograph, camera)

    if query.cam_from_world is None:
        print(query.reason)
    else:
        x, y, z = query.cam_from_world.center
        print(f"{query.verdict}: taken at ({x:.2f}, {y:.2f}, {z:.2f})")


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "assets/demo"))
