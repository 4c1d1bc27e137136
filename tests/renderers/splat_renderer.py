"""Gaussian splats as rays see them, by the published equations and nothing else: every Gaussian for
every ray, in double. splat_renderer.py SPLATS.ply RAYS.txt, with the eye in the first line of RAYS.txt
and a direction in each other one, prints for each ray: red, green, blue, the light that is left, and
where a surface is: the median, expected and peak t, and the spread about the median ("none" else)."""

import sys

import numpy as np


def read(path):
    data = open(path, "rb").read()
    header, body = data.split(b"end_header\n", 1)
    names = [line.split()[2] for line in header.decode().splitlines() if line.startswith("property")]
    rows = np.frombuffer(body, [(name, "<f4") for name in names])
    columns = lambda *wanted: np.stack([rows[name].astype(float) for name in wanted], 1)
    rest = sum(name.startswith("f_rest_") for name in names) // 3
    harmonics = np.concatenate(
        [columns("f_dc_0", "f_dc_1", "f_dc_2")[:, None]]
        + [columns(*[f"f_rest_{channel * rest + i}" for channel in range(3)])[:, None] for i in range(rest)], 1)
    return (columns("x", "y", "z"), columns("rot_0", "rot_1", "rot_2", "rot_3"),
            np.exp(columns(*[name for name in names if name.startswith("scale_")])),
            1 / (1 + np.exp(-columns("opacity")[:, 0])), harmonics)


def rotations(q):
    """Of unit quaternions w x y z, by Rodrigues' formula."""
    q = q / np.linalg.norm(q, axis=1, keepdims=True)
    cross = np.zeros((len(q), 3, 3))
    x, y, z = q[:, 1:].T
    cross[:, 0, 1], cross[:, 0, 2], cross[:, 1, 2] = -z, y, -x
    cross -= cross.transpose(0, 2, 1)
    return np.eye(3) + 2 * q[:, :1, None] * cross + 2 * cross @ cross


def basis(d):
    """Real spherical harmonics up to degree 3, with the factors that make their squares' mean 1 / 4 pi."""
    x, y, z = d.T
    one = np.ones_like(x)
    pi = np.pi
    return np.stack([
        one * np.sqrt(1 / (4 * pi)),
        -np.sqrt(3 / (4 * pi)) * y, np.sqrt(3 / (4 * pi)) * z, -np.sqrt(3 / (4 * pi)) * x,
        np.sqrt(15 / (4 * pi)) * x * y, -np.sqrt(15 / (4 * pi)) * y * z,
        np.sqrt(5 / (16 * pi)) * (3 * z**2 - 1),
        -np.sqrt(15 / (4 * pi)) * x * z, np.sqrt(15 / (16 * pi)) * (x**2 - y**2),
        -np.sqrt(35 / (32 * pi)) * y * (3 * x**2 - y**2), np.sqrt(105 / (4 * pi)) * x * y * z,
        -np.sqrt(21 / (32 * pi)) * y * (5 * z**2 - 1), np.sqrt(7 / (16 * pi)) * z * (5 * z**2 - 3),
        -np.sqrt(21 / (32 * pi)) * x * (5 * z**2 - 1), np.sqrt(105 / (16 * pi)) * z * (x**2 - y**2),
        -np.sqrt(35 / (32 * pi)) * x * (x**2 - 3 * y**2)], 1)


def alphas(mean, axes, scale, opacity, eye, d):
    """t and alpha of each Gaussian, and its own variance along the ray."""
    if scale.shape[1] == 2:  # Discs: where the ray meets their planes.
        normal = axes[:, :, 2]
        t = ((mean - eye) * normal).sum(1) / (normal @ d)
        on_plane = np.einsum("nij,ni->nj", axes, eye + t[:, None] * d - mean)[:, :2] / scale
        return t, opacity * np.exp(-0.5 * (on_plane**2).sum(1)), np.zeros(len(t))
    inverse = np.einsum("nij,nj,nkj->nik", axes, 1 / scale**2, axes)
    along = np.einsum("i,nij,j->n", d, inverse, d)
    t = np.einsum("i,nij,nj->n", d, inverse, mean - eye) / along
    off = eye + t[:, None] * d - mean
    return t, opacity * np.exp(-0.5 * np.einsum("ni,nij,nj->n", off, inverse, off)), 1 / along


def main():
    mean, quaternion, scale, opacity, harmonics = read(sys.argv[1])
    rays = np.loadtxt(sys.argv[2])
    eye = rays[0]
    axes = rotations(quaternion)
    toward = mean - eye
    toward /= np.linalg.norm(toward, axis=1, keepdims=True)
    color = 0.5 + np.einsum("ni,nic->nc", basis(toward)[:, :harmonics.shape[1]], harmonics)
    color = np.maximum(color, 0)
    for d in rays[1:]:
        d = d / np.linalg.norm(d)
        t, alpha, own = alphas(mean, axes, scale, opacity, eye, d)
        left, rgb, weights, ts, variances, median = 1.0, np.zeros(3), [], [], [], None
        for i in np.argsort(t):
            a = min(0.99, alpha[i])
            if t[i] <= 0 or a < 1 / 255:
                continue
            if left * (1 - a) < 1e-4:
                break
            weights.append(left * a)
            ts.append(t[i])
            variances.append(own[i])
            rgb += left * a * color[i]
            left *= 1 - a
            if median is None and left <= 0.5:
                median = t[i]
        surface = "none none none none"
        if median is not None:
            w, t = np.array(weights), np.array(ts)
            variance = (w * ((t - median)**2 + variances)).sum() / w.sum()
            found = [median, (w * t).sum() / w.sum(), t[w.argmax()], np.sqrt(variance)]
            surface = " ".join(repr(float(v)) for v in found)
        print(*[repr(float(v)) for v in rgb], repr(float(left)), surface)


main()
