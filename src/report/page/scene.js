// A view of a mesh, points and cameras on a canvas, drawn here so that it needs no graphics card: drag to turn, wheel or pinch to zoom, shift-drag to move.
function decodeFloats(text) {
  const bytes = Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
  return new Float32Array(bytes.buffer);
}
function decodeBytes(text) { return Uint8Array.from(atob(text), (c) => c.charCodeAt(0)); }

class SceneView {
  // scene: {points, colors (base64), cameras: [{kind, name, center, axes (right, down, forward), ratio}],
  // mesh: {vertices, colors, triangles (base64)}}; `onPick` is told of a camera that is clicked.
  constructor(canvas, scene, onPick) {
    this.canvas = canvas;
    canvas.view = this;
    this.onPick = onPick;
    this.mesh = scene.mesh ? { vertices: decodeFloats(scene.mesh.vertices), colors: decodeBytes(scene.mesh.colors),
      triangles: new Uint32Array(decodeBytes(scene.mesh.triangles).buffer) } : null;
    this.showMesh = this.mesh !== null;
    this.points = decodeFloats(scene.points);
    this.colors = decodeBytes(scene.colors);
    this.cameras = scene.cameras;
    this.shown = new Set(scene.cameras.map((camera) => camera.kind));
    this.up = scene.up;
    const { center, radius } = this.bounds();
    this.center = center;
    this.radius = radius;
    this.frames = 0;
    this.home();
    this.listen();
    new ResizeObserver(() => this.draw()).observe(canvas);
    this.draw();
  }

  bounds() {
    const axes = [[], [], []];
    for (let i = 0; i < this.points.length; ++i) axes[i % 3].push(this.points[i]);
    if (this.mesh) for (let i = 0; i < this.mesh.vertices.length; ++i) axes[i % 3].push(this.mesh.vertices[i]);
    for (const camera of this.cameras) camera.center.forEach((value, axis) => axes[axis].push(value));
    const center = [], half = [];
    for (const values of axes) {
      values.sort((a, b) => a - b);
      const low = values[Math.floor(0.02 * (values.length - 1))] || 0;
      const high = values[Math.ceil(0.98 * (values.length - 1))] || 0;
      center.push((low + high) / 2);
      half.push((high - low) / 2);
    }
    return { center, radius: Math.hypot(...half) || 1 };
  }

  home() {
    this.target = [...this.center];
    this.distance = 1.4 * this.radius;
    this.azimuth = 0.7;
    this.elevation = 0.55;
    this.draw();
  }

  // To where the camera stands, looking where it looks; from a little behind, so that it is seen.
  flyTo(camera) {
    const forward = camera.axes[2];
    const [u, v, w] = this.up;
    const along = (axis) => axis.reduce((sum, value, i) => sum + value * forward[i], 0);
    const distance = 0.35 * this.radius;
    const to = { azimuth: Math.atan2(-along(v), -along(u)), elevation: Math.asin(Math.max(-1, Math.min(1, -along(w)))),
      distance, target: camera.center.map((value, i) => value + 0.6 * distance * forward[i]) };
    const from = { azimuth: this.azimuth, elevation: this.elevation, distance: this.distance, target: [...this.target] };
    to.azimuth = from.azimuth + Math.atan2(Math.sin(to.azimuth - from.azimuth), Math.cos(to.azimuth - from.azimuth));
    const flight = {};
    this.flight = flight;
    const begin = performance.now();
    const step = () => {
      if (this.flight !== flight) return;
      const share = Math.min(1, (performance.now() - begin) / 600);
      const eased = share * share * (3 - 2 * share);
      const mix = (a, b) => a + eased * (b - a);
      for (const key of ["azimuth", "elevation", "distance"]) this[key] = mix(from[key], to[key]);
      this.target = from.target.map((value, i) => mix(value, to.target[i]));
      this.draw();
      if (share < 1) requestAnimationFrame(step);
      else this.canvas.dataset.at = camera.name;
    };
    step();
  }

  // The camera whose center is drawn the nearest, within a finger's width.
  pick(x, y) {
    const scale = this.canvas.width / this.canvas.clientWidth;
    let best = null, least = 14 * scale;
    for (const camera of this.cameras) {
      const place = this.shown.has(camera.kind) ? this.project(camera.center) : null;
      if (!place) continue;
      const distance = Math.hypot(place[0] - scale * x, place[1] - scale * y);
      if (distance < least) [best, least] = [camera, distance];
    }
    return best;
  }

  listen() {
    const pointers = new Map();
    const canvas = this.canvas;
    let pressed = null;
    canvas.addEventListener("pointerdown", (event) => {
      this.flight = null;
      pressed = [event.clientX, event.clientY];
      canvas.setPointerCapture(event.pointerId);
      pointers.set(event.pointerId, [event.clientX, event.clientY]);
    });
    canvas.addEventListener("pointermove", (event) => {
      const before = pointers.get(event.pointerId);
      if (!before) return;
      const dx = event.clientX - before[0], dy = event.clientY - before[1];
      const others = [...pointers].filter(([id]) => id !== event.pointerId).map(([, place]) => place);
      if (others.length > 0) {
        const span = (place) => Math.hypot(place[0] - others[0][0], place[1] - others[0][1]) || 1;
        this.distance *= span(before) / span([event.clientX, event.clientY]);
      } else if (event.shiftKey) {
        this.move(-dx, -dy);
      } else {
        this.azimuth -= dx * 0.008;
        this.elevation = Math.max(-1.5, Math.min(1.5, this.elevation + dy * 0.008));
      }
      pointers.set(event.pointerId, [event.clientX, event.clientY]);
      this.draw();
    });
    canvas.addEventListener("pointerup", (event) => {
      if (!pressed || Math.hypot(event.clientX - pressed[0], event.clientY - pressed[1]) > 4) return;
      const frame = canvas.getBoundingClientRect();
      const camera = this.pick(event.clientX - frame.left, event.clientY - frame.top);
      if (camera && this.onPick) this.onPick(camera);
    });
    for (const name of ["pointerup", "pointercancel"]) {
      canvas.addEventListener(name, (event) => pointers.delete(event.pointerId));
    }
    canvas.addEventListener("wheel", (event) => {
      event.preventDefault();
      this.distance *= Math.exp(event.deltaY * 0.001);
      this.draw();
    }, { passive: false });
    canvas.addEventListener("keydown", (event) => {
      const turn = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] }[event.key];
      if (turn) {
        this.azimuth += 0.1 * turn[0];
        this.elevation = Math.max(-1.5, Math.min(1.5, this.elevation + 0.1 * turn[1]));
      } else if (event.key === "+" || event.key === "-") {
        this.distance *= event.key === "+" ? 0.9 : 1.1;
      } else {
        return;
      }
      event.preventDefault();
      this.draw();
    });
  }

  // The viewer's right, down and forward axes.
  axes() {
    const [u, v, w] = this.up; // the world's axes: two level ones and the one that points up
    const level = (i) => Math.cos(this.azimuth) * u[i] + Math.sin(this.azimuth) * v[i];
    const across = (i) => -Math.sin(this.azimuth) * u[i] + Math.cos(this.azimuth) * v[i];
    const sin = Math.sin(this.elevation), cos = Math.cos(this.elevation);
    return [
      [0, 1, 2].map((i) => across(i)),
      [0, 1, 2].map((i) => sin * level(i) - cos * w[i]),
      [0, 1, 2].map((i) => -cos * level(i) - sin * w[i]),
    ];
  }

  move(dx, dy) {
    const [right, down] = this.axes();
    const unit = this.distance / this.canvas.clientHeight;
    for (let i = 0; i < 3; ++i) this.target[i] += unit * (dx * right[i] + dy * down[i]);
  }

  draw() {
    if (this.pending) return;
    this.pending = true;
    requestAnimationFrame(() => {
      this.pending = false;
      this.paint();
    });
  }

  paint() {
    const canvas = this.canvas;
    const scale = Math.min(2, window.devicePixelRatio || 1);
    const width = Math.max(1, Math.round(canvas.clientWidth * scale));
    const height = Math.max(1, Math.round(canvas.clientHeight * scale));
    if (canvas.width !== width || canvas.height !== height) [canvas.width, canvas.height] = [width, height];
    const context = canvas.getContext("2d");
    const image = context.createImageData(width, height);
    const pixels = new Uint32Array(image.data.buffer).fill(0xff171310);
    const depths = new Float32Array(width * height).fill(Infinity);
    const [right, down, forward] = this.axes();
    const eye = this.target.map((t, i) => t - this.distance * forward[i]);
    const focal = 1.1 * Math.min(width, height);
    this.project = (p) => {
      const d = [p[0] - eye[0], p[1] - eye[1], p[2] - eye[2]];
      const dot = (a) => a[0] * d[0] + a[1] * d[1] + a[2] * d[2];
      const z = dot(forward);
      return z > 1e-6 * this.radius ? [width / 2 + (focal * dot(right)) / z, height / 2 + (focal * dot(down)) / z, z] : null;
    };
    if (this.showMesh) this.paintMesh(pixels, depths, width, height, eye, [right, down, forward], focal);
    const size = Math.max(1, Math.round(2 * scale));
    for (let i = 0; i < this.points.length; i += 3) {
      const place = this.project([this.points[i], this.points[i + 1], this.points[i + 2]]);
      if (!place) continue;
      const x = Math.round(place[0]), y = Math.round(place[1]);
      const color = 0xff000000 | (this.colors[i + 2] << 16) | (this.colors[i + 1] << 8) | this.colors[i];
      for (let v = y; v < y + size; ++v) {
        for (let u = x; u < x + size; ++u) {
          if (u < 0 || v < 0 || u >= width || v >= height) continue;
          const at = v * width + u;
          if (place[2] < depths[at]) { depths[at] = place[2]; pixels[at] = color; }
        }
      }
    }
    context.putImageData(image, 0, 0);
    context.lineWidth = 1.5 * scale;
    for (const camera of this.cameras) if (this.shown.has(camera.kind)) this.paintCamera(context, camera);
    if (this.walk) this.paintWalk(context);
    this.frames += 1;
    canvas.dataset.frames = this.frames;
  }

  // Triangles with a depth buffer, each of the mean color of its corners, lit from the viewer.
  paintMesh(pixels, depths, width, height, eye, axes, focal) {
    const { vertices, colors, triangles } = this.mesh;
    const count = vertices.length / 3;
    const seen = new Float32Array(3 * count);
    for (let i = 0; i < count; ++i) {
      const dx = vertices[3 * i] - eye[0], dy = vertices[3 * i + 1] - eye[1], dz = vertices[3 * i + 2] - eye[2];
      for (let k = 0; k < 3; ++k) seen[3 * i + k] = axes[k][0] * dx + axes[k][1] * dy + axes[k][2] * dz;
    }
    // What stands between a viewer outside and all cameras, as the near wall of a room, is cut away.
    const cameraDepths = this.cameras.map((camera) => camera.center.reduce((sum, value, i) => sum + axes[2][i] * (value - eye[i]), 0));
    const cut = (cameraDepths.length ? Math.min(...cameraDepths) : 0) - 0.1 * this.radius;
    const near = 0.01 * this.radius;
    for (let t = 0; t < triangles.length; t += 3) {
      const a = 3 * triangles[t], b = 3 * triangles[t + 1], c = 3 * triangles[t + 2];
      const za = seen[a + 2], zb = seen[b + 2], zc = seen[c + 2];
      if (za < near || zb < near || zc < near) continue;
      const xa = width / 2 + (focal * seen[a]) / za, ya = height / 2 + (focal * seen[a + 1]) / za;
      const xb = width / 2 + (focal * seen[b]) / zb, yb = height / 2 + (focal * seen[b + 1]) / zb;
      const xc = width / 2 + (focal * seen[c]) / zc, yc = height / 2 + (focal * seen[c + 1]) / zc;
      const left = Math.max(0, Math.ceil(Math.min(xa, xb, xc) - 0.5)), rightmost = Math.min(width - 1, Math.floor(Math.max(xa, xb, xc) - 0.5));
      const top = Math.max(0, Math.ceil(Math.min(ya, yb, yc) - 0.5)), bottom = Math.min(height - 1, Math.floor(Math.max(ya, yb, yc) - 0.5));
      if (left > rightmost || top > bottom) continue;
      const area = (xb - xa) * (yc - ya) - (xc - xa) * (yb - ya);
      if (area === 0) continue;
      const ux = seen[b] - seen[a], uy = seen[b + 1] - seen[a + 1], uz = zb - za;
      const vx = seen[c] - seen[a], vy = seen[c + 1] - seen[a + 1], vz = zc - za;
      const nx = uy * vz - uz * vy, ny = uz * vx - ux * vz, nz = ux * vy - uy * vx;
      const sight = Math.hypot(seen[a], seen[a + 1], za) * Math.hypot(nx, ny, nz) || 1;
      const light = 0.55 + (0.45 * Math.abs(nx * seen[a] + ny * seen[a + 1] + nz * za)) / sight;
      let color = 0xff000000;
      for (let k = 0; k < 3; ++k) color |= ((light * (colors[a + k] + colors[b + k] + colors[c + k])) / 3) << (8 * k);
      for (let y = top; y <= bottom; ++y) {
        for (let x = left; x <= rightmost; ++x) {
          const px = x + 0.5, py = y + 0.5;
          const wb = ((px - xa) * (yc - ya) - (xc - xa) * (py - ya)) / area;
          const wc = ((xb - xa) * (py - ya) - (px - xa) * (yb - ya)) / area;
          if (wb < 0 || wc < 0 || wb + wc > 1) continue;
          // Inverse depth is linear in the picture.
          const z = 1 / ((1 - wb - wc) / za + wb / zb + wc / zc);
          const at = y * width + x;
          if (z > cut && z < depths[at]) { depths[at] = z; pixels[at] = color; }
        }
      }
    }
  }

  paintCamera(context, camera) {
    const length = 0.05 * this.radius;
    const corner = (x, y) => [0, 1, 2].map((i) => camera.center[i] + length *
      (x * camera.axes[0][i] + y * camera.ratio * camera.axes[1][i] + 1.2 * camera.axes[2][i]));
    const corners = [corner(-0.7, -0.7), corner(0.7, -0.7), corner(0.7, 0.7), corner(-0.7, 0.7)].map(this.project);
    const center = this.project(camera.center);
    if (!center || corners.some((c) => !c)) return;
    context.strokeStyle = SceneView.colorOf(camera.kind);
    context.beginPath();
    corners.forEach((c, i) => {
      context.moveTo(center[0], center[1]);
      context.lineTo(c[0], c[1]);
      context.lineTo(...corners[(i + 1) % 4].slice(0, 2));
    });
    if (camera.from) {
      const from = this.project(camera.from);
      if (from) { context.moveTo(center[0], center[1]); context.lineTo(from[0], from[1]); }
    }
    context.stroke();
  }

  // The way from frame to frame of each walk, broken where odometry was lost, and where one is now.
  paintWalk(context) {
    const camera = (frame) => this.cameras.find((one) => one.name === frame.query && !["reference", "single"].includes(one.kind));
    context.strokeStyle = "#4aa8ff";
    context.beginPath();
    let before = null, walk = null;
    for (const frame of this.walk) {
      const place = camera(frame) ? this.project(camera(frame).center) : null;
      if (place && before && frame.walk === walk && !frame.lost_before) { context.moveTo(before[0], before[1]); context.lineTo(place[0], place[1]); }
      before = place;
      walk = frame.walk;
    }
    context.stroke();
    const now = this.walkAt === undefined ? null : camera(this.walk[this.walkAt]);
    const place = now ? this.project(now.center) : null;
    if (!place) return;
    context.fillStyle = "#ffffff";
    context.beginPath();
    context.arc(place[0], place[1], 4 * context.lineWidth, 0, 2 * Math.PI);
    context.fill();
  }

  static colorOf(kind) {
    return { reference: "#9aa5b1", single: "#e06c9f", true: "#56d3a5", estimated: "#ffab4a", localized: "#56d3a5", doubtful: "#ffab4a" }[kind] || "#ffffff";
  }
}
