"""A small room that the server localizes in, and what good and hostile clients send it."""

import base64
import http.client
import json
import pathlib
import random
import signal
import socket
import struct
import subprocess
import sys
import time

import faults_test as faults

SIZE = (6.0, 5.0, 3.0)  # of the room, from the origin
CAMERA = "PINHOLE 160 120 130 130 80 60"
WIDTH, HEIGHT, FOCAL = 160, 120, 130.0
BOUNDARY = "raylift-test-boundary"
SCENE = """format = "raylift-scene/1"
name = "room"
references = "model"
images = "rendered/color"
[[geometry]]
name = "mesh"
spec = "mesh:room.ply"
"""


# ---- the scene and matches in it ----

def make_room(raylift, work):
    """The scene's file; photographs are in photos/color."""
    work.mkdir(parents=True)
    faults.write_room(work / "room.ply")
    faults.write_model(work / "model", ["r0.png", "r1.png", "r2.png"], 0.0)
    faults.write_model(work / "truth", ["q0.png", "q1.png"], 0.07)
    for cameras, out in (("model", "rendered"), ("truth", "photos")):
        faults.run_plain(raylift, work, faults.RENDER + ["--model", cameras, "--out", out])
    (work / "scene.toml").write_text(SCENE)
    return work / "scene.toml"


def rotation(w, x, y, z):
    return ((1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
            (2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
            (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)))


class View:
    """A camera in the room, by its line of images.txt."""

    def __init__(self, line):
        words = line.split()
        self.name = words[9]
        self.rows = rotation(*map(float, words[1:5]))
        self.translation = [float(word) for word in words[5:8]]
        self.center = [-sum(self.rows[k][i] * self.translation[k] for k in range(3)) for i in range(3)]

    def point(self, x, y):
        """Where the wall is that this pixel shows."""
        ray_in_cam = ((x - WIDTH / 2) / FOCAL, (y - HEIGHT / 2) / FOCAL, 1.0)
        ray = [sum(self.rows[k][i] * ray_in_cam[k] for k in range(3)) for i in range(3)]
        t = min(((size if along > 0 else 0.0) - at) / along
                for size, at, along in zip(SIZE, self.center, ray) if along != 0)
        return [at + t * along for at, along in zip(self.center, ray)]

    def pixel(self, point):
        """None where the point is not in the picture."""
        x, y, z = (sum(r * p for r, p in zip(row, point)) + t for row, t in zip(self.rows, self.translation))
        if z <= 0:
            return None
        pixel = (FOCAL * x / z + WIDTH / 2, FOCAL * y / z + HEIGHT / 2)
        return pixel if 0 <= pixel[0] < WIDTH and 0 <= pixel[1] < HEIGHT else None


def views(folder):
    return [View(line) for line in (folder / "images.txt").read_text().splitlines() if line.strip()]


def matches_of(rng, query, references, most):
    """A fifth of them is wrong."""
    found = []
    for reference in references:
        of_query, of_reference = [], []
        for i in range(most):
            seen = [rng.uniform(0, WIDTH), rng.uniform(0, HEIGHT)]
            pixel = reference.pixel(query.point(*seen))
            if i % 5 == 0:
                pixel = (rng.uniform(0, WIDTH), rng.uniform(0, HEIGHT))
            if pixel:
                of_query.append(seen)
                of_reference.append([min(max(p + rng.gauss(0, 0.3), 0), most_px)
                                     for p, most_px in zip(pixel, (WIDTH, HEIGHT))])
        found.append({"reference": reference.name, "query_px": of_query, "reference_px": of_reference})
    return found


# ---- requests ----

class Request:
    """What is posted; `bytes` is all of it as it travels."""

    def __init__(self, body, content_type, path="/v1/localize"):
        self.body, self.content_type, self.path = body, content_type, path

    @property
    def bytes(self):
        return (f"POST {self.path} HTTP/1.1\r\nHost: a\r\nContent-Type: {self.content_type}\r\n"
                f"Content-Length: {len(self.body)}\r\n\r\n").encode() + self.body


def json_request(value):
    body = value if isinstance(value, bytes) else json.dumps(value).encode()
    return Request(body, "application/json")


def form_request(*parts, path="/v1/localize"):
    """`parts` are (name, content)."""
    body = b"".join(f'--{BOUNDARY}\r\nContent-Disposition: form-data; name="{name}"; filename="{name}"\r\n\r\n'.encode()
                    + content + b"\r\n" for name, content in parts)
    return Request(body + f"--{BOUNDARY}--\r\n".encode(), f"multipart/form-data; boundary={BOUNDARY}", path)


def match_requests(work, count=16):
    rng, references = random.Random(2), views(work / "model")
    asked = []
    for i in range(count):
        query = views(work / "truth")[i % 2]
        asked.append(json_request({"name": f"{i}", "camera": CAMERA,
                                   "matches": matches_of(rng, query, references, rng.choice((3, 30, 60)))}))
    return asked


def image_requests(work):
    query = json.dumps({"camera": CAMERA}).encode()
    asked = []
    for name in ("q0.png", "q1.png"):
        photograph = (work / "photos/color" / name).read_bytes()
        asked += [form_request(("image", photograph), ("query", query)), form_request(("image", photograph)),
                  form_request(("image", photograph), ("image", b"no photograph"), path="/v1/localize/batch"),
                  json_request({"camera": CAMERA, "image": base64.b64encode(photograph).decode()})]
    return asked


def png_header(width, height):
    return (b"\x89PNG\r\n\x1a\n" + struct.pack(">I4sIIBBBBB", 13, b"IHDR", width, height, 8, 0, 0, 0, 0)
            + b"\0" * 4)


REFUSED = range(400, 500)
ANY = (200, *REFUSED)  # what chance has changed may still be good


class Hostile:
    """What a client sends, and the statuses that may answer it: None where it goes at once."""

    def __init__(self, sent, expected=REFUSED):
        self.sent, self.expected = sent, expected


def hostile(rng, good):
    """One of many kinds, made of a good request."""
    head, body = good.bytes.split(b"\r\n\r\n", 1)
    post = b"POST /v1/localize HTTP/1.1\r\nHost: a\r\n"
    of_json = post + b"Content-Type: application/json\r\n"

    def changed():
        data = bytearray(good.body)
        for _ in range(rng.choice((1, 3, 30))):
            data[rng.randrange(len(data))] = rng.randrange(256)
        return Hostile(Request(bytes(data), good.content_type, good.path).bytes, ANY)

    def cut():
        cut_body = good.body[:rng.randrange(len(good.body))]
        return Hostile(Request(cut_body, good.content_type, good.path).bytes)

    def wrong_value():
        camera = rng.choice((CAMERA, CAMERA.replace("130", "nan"), CAMERA.replace("160", "-1"), 3, None, "A" * 5000))
        return Hostile(json_request({"camera": camera, "matches": rng.choice((
            3, [3], [{}], [{"reference": "no", "query_px": [], "reference_px": []}],
            [{"reference": "r0.png", "query_px": [[1, "a"]], "reference_px": [[1, 2]]}],
            [{"reference": "r0.png", "query_px": [[1, 2]], "reference_px": []}]))}).bytes)

    kinds = [
        changed, cut, wrong_value,
        lambda: Hostile(json_request(b"[" * rng.randrange(1, 100000)).bytes),
        lambda: Hostile(json_request(b'{"matches": [1e999, NaN]}').bytes),
        lambda: Hostile(form_request(("image", b"a text" * 100)).bytes),
        lambda: Hostile(form_request(("image", png_header(60000, 60000) + b"\0" * 1000)).bytes),
        lambda: Hostile(form_request(("image", png_header(*(rng.randrange(1 << 31) for _ in range(2))))).bytes),
        lambda: Hostile(form_request(("other", b"")).bytes),
        lambda: Hostile(good.bytes.replace(b"/v1/localize", b"/v1/localize?scene=no%00ne", 1)),
        lambda: Hostile(good.bytes.replace(b"/v1/localize", b"/../../etc/passwd", 1)),
        lambda: Hostile(of_json + b"Content-Length: 3\r\nTransfer-Encoding: chunked\r\n\r\n0\r\n\r\n"),
        lambda: Hostile(of_json + b"Content-Length: 3\r\nContent-Length: 4\r\n\r\n{} "),
        lambda: Hostile(of_json + b"Transfer-Encoding: chunked\r\n\r\n" + rng.choice((b"g\r\n", b"-1\r\n", b"5\r\n{}"
                                                                                      b"\r\n0\r\n\r\n"))),
        lambda: Hostile(of_json + b"Transfer-Encoding: chunked\r\n\r\nfffffffffffffffff\r\n"),
        lambda: Hostile(of_json + b"Content-Length: 99999999999999999999\r\n\r\n"),
        lambda: Hostile(of_json + b"Content-Length: 1000000000\r\n\r\n"),
        lambda: Hostile(post + b"A: " + b"a" * 100000 + b"\r\n\r\n"),
        lambda: Hostile(bytes(rng.randrange(256) for _ in range(rng.randrange(1, 300))) + b"\r\n\r\n"),
        lambda: Hostile(head + b"\r\n\r\n" + body[:len(body) // 2], None),
        lambda: Hostile(head[:rng.randrange(len(head))], None),
        lambda: Hostile(good.bytes, None),
        lambda: Hostile(good.bytes * 20, None),
    ]
    return rng.choice(kinds)()


# ---- the server and its clients ----

class RoomServer:
    """The program's server on the room."""

    def __init__(self, raylift, work, *options, environment=None):
        command = [raylift, "serve", "scene.toml", "--port", "0", "--threads", "2", "--max-features", "300",
                   "--deadline", "600s", *options]
        self.told = open(work / "serve.stderr", "w+")
        self.process = subprocess.Popen(list(map(str, command)), cwd=work, env=environment, text=True,
                                        stdout=subprocess.PIPE, stderr=self.told)
        line = self.process.stdout.readline()
        self.address = ("127.0.0.1", int(line.rsplit(":", 1)[1])) if line else None  # None: it has ended

    def __enter__(self):
        return self

    def __exit__(self, *_):
        if self.process.poll() is None:
            self.process.kill()
        self.process.wait()
        self.process.stdout.close()
        self.told.close()

    def end(self):
        """Its exit code and what it has said."""
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGTERM)
        code = self.process.wait(timeout=600)
        self.told.seek(0)
        return code, self.told.read()

    def resident_bytes(self):
        status = pathlib.Path(f"/proc/{self.process.pid}/status").read_text()
        return next(int(line.split()[1]) * 1024 for line in status.splitlines() if line.startswith("VmRSS"))

    def connect(self):
        return http.client.HTTPConnection(*self.address, timeout=600)

    def get(self, path):
        connection = self.connect()
        connection.request("GET", path)
        answer = connection.getresponse()
        body = answer.read().decode()
        connection.close()
        return answer.status, body

    def gauge(self, name):
        return next(float(line.split()[1]) for line in self.get("/metrics")[1].splitlines()
                    if line.startswith(name + " "))


def post(connection, request):
    """The status and the body of the answer."""
    connection.request("POST", request.path, request.body, {"Content-Type": request.content_type})
    answer = connection.getresponse()
    return answer.status, answer.read()


def attack(address, attempt):
    """The status that it is answered with: None where it has gone before, 0 where nothing came."""
    with socket.create_connection(address, timeout=600) as connection:
        try:
            connection.sendall(attempt.sent)
        except ConnectionError:  # it has been answered before all was read
            pass
        if attempt.expected is None:
            return None
        try:
            first = connection.recv(65536)
        except ConnectionError:
            return 0
        return int(first.split()[1]) if first.startswith(b"HTTP/1.1 ") else 0


def wait_until_idle(server):
    """What is still held after a minute."""
    for _ in range(600):
        held = {name: server.gauge(name) for name in ("raylift_queue_waiting", "raylift_threads_busy",
                                                      "raylift_body_bytes")}
        # The one that asks is a connection.
        held["raylift_connections"] = server.gauge("raylift_connections") - 1
        if not any(held.values()):
            return []
        time.sleep(0.1)
    return [f"at the end there is still {held}"]


def wrong_at_the_end(server):
    """Ends the server; what is wrong with that."""
    code, said = server.end()
    return [f"the server ended with {code}: {said}"] if code != 0 or said else []


def conclude(wrong):
    """Ends the test."""
    for text in wrong[:20]:
        print(text)
    if wrong:
        sys.exit(f"{len(wrong)} failures")
