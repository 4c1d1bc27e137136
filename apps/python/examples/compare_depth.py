"""Which of two sources of depth is better, and how much? compare_depth.py [DEMO [OUT]]"""

import sys
from pathlib import Path

import raylift


def main(demo: Path, out: Path) -> None:
    mesh = f"mesh:{demo / 'scene.obj'}"
    raylift.run("perturb", model=demo / "model", geometry=mesh, out=out / "scaled", scale=1.1)
    result = raylift.compare(demo / "model", {"mesh": mesh, "scaled": f"depth:{out / 'scaled'}"},
                             out / "comparison", truth="mesh", max_side=160)
    errors = {}
    for source in result["depth"]["sources"]:
        error = source["means"]["abs_rel"]
        if error is not None and not source["is_truth"]:
            errors[source["name"]] = error
            findings = "; ".join(finding["text"] for finding in source["findings"])
            print(f"{source['name']}: mean relative error {error:.3f}; {findings}")
    try:
        import matplotlib.pyplot as plt
    except ImportError:
        return
    plt.bar(list(errors), list(errors.values()))
    plt.ylabel("mean relative error")
    plt.savefig(out / "errors.png")


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "assets/demo"),
         Path(sys.argv[2] if len(sys.argv) > 2 else "out/python_compare"))
