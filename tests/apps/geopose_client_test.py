"""Open AR Cloud's own client of its GeoPose Protocol: geopose_client_test.py SOURCE_FOLDER RAYLIFT WORK_FOLDER

Installs @oarc/gpp-access by npm below the work folder and localizes a photograph of the demo by it, on a
`raylift serve` of its own. Its validation is on: request and answer have the protocol's form. Skipped with a
message, and the exit code 77, where there is no npm or no registry.
"""

import json
import math
import pathlib
import shutil
import subprocess
import sys

SKIPPED = 77
SOURCE, RAYLIFT, WORK = (pathlib.Path(a).resolve() for a in sys.argv[1:4])
DEMO = SOURCE / "assets/demo"
ORIGIN = (500000, 5400000, 200)  # on the central meridian: east and north are the map's

LATITUDE = 48.753013001  # of the origin
E2 = 0.00669437999014  # of the ellipsoid of WGS 84

# What the package's README shows, with the signatures that it has.
SCRIPT = """
import { readFileSync } from 'node:fs';
import { CAMERAMODEL, CameraParam, GeoPoseRequest, IMAGEFORMAT, ImageOrientation, Privacy, SENSORTYPE, Sensor,
         sendRequest, validateRequest } from '@oarc/gpp-access';
const [url, photograph, camera, latitude, longitude] = process.argv.slice(2);
const [model, width, height, ...params] = camera.split(' ');
const cameraParams = new CameraParam();
cameraParams.model = CAMERAMODEL[model];
cameraParams.modelParams = params.map(Number);
const image = readFileSync(photograph).toString('base64');
const now = Date.now();
const request = new GeoPoseRequest('query')
  .addSensor(new Sensor('camera', SENSORTYPE.camera))
  .addSensor(new Sensor('gnss', SENSORTYPE.geolocation))
  .addCameraData(IMAGEFORMAT.JPG, [Number(width), Number(height)], image, 0, new ImageOrientation(false, 0),
                 cameraParams, now, 'camera', new Privacy())
  .addGeoLocationData(Number(latitude), Number(longitude), 0, 10, 0, NaN, 0, now, 'gnss', new Privacy());
validateRequest(true);
console.log(JSON.stringify(await sendRequest(url + '/geopose', JSON.stringify(request))));
"""


def skip(message):
    print("skipped: " + message)
    sys.exit(SKIPPED)


def true_center(name):
    """The camera's, in the world."""
    lines = (DEMO / "ground_truth/images.txt").read_text().splitlines()
    line = next(line for line in lines if line.endswith(name))
    w, x, y, z, *t = map(float, line.split()[1:8])
    rotation = ((1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
                (2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
                (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)))
    return [-sum(rotation[row][i] * t[row] for row in range(3)) for i in range(3)]


def install():
    if shutil.which("npm") is None or shutil.which("node") is None:
        skip("npm or node is not installed")
    shutil.rmtree(WORK, ignore_errors=True)
    WORK.mkdir(parents=True)
    (WORK / "package.json").write_text('{"type": "module", "private": true}')
    done = subprocess.run(["npm", "install", "--no-audit", "--no-fund", "--ignore-scripts", "@oarc/gpp-access@0.2.1",
                           "esbuild@0.25"], cwd=WORK, capture_output=True, text=True)
    if done.returncode != 0:
        skip("npm: " + done.stderr.strip().splitlines()[0])
    (WORK / "client.mjs").write_text(SCRIPT)
    # Its imports are for bundlers: they name folders.
    subprocess.run(["node_modules/.bin/esbuild", "client.mjs", "--bundle", "--platform=node", "--format=esm",
                    "--outfile=bundle.mjs", "--log-level=warning"], cwd=WORK, check=True)


def ask(url, name, camera):
    # Some meters off, as phones are.
    done = subprocess.run(["node", "bundle.mjs", url, DEMO / "images" / name, camera, "48.75310", "9.00012"],
                          cwd=WORK, capture_output=True, text=True, timeout=600)
    if done.returncode != 0:
        sys.exit(done.stderr)
    return json.loads(done.stdout)


def errors(answer, name):
    """East, north and up of the truth, in meters: by the radii of the ellipsoid and the map's scale."""
    position = answer["geopose"]["position"]
    s2 = math.sin(math.radians(position["lat"])) ** 2
    across = 6378137 / math.sqrt(1 - E2 * s2)
    along = across * (1 - E2) / (1 - E2 * s2)
    east, north, up = true_center(name)
    return (0.9996 * math.radians(position["lon"] - 9) * across * math.cos(math.radians(position["lat"])) - east,
            0.9996 * math.radians(position["lat"] - LATITUDE) * along - north, position["h"] - ORIGIN[2] - up)


def main():
    install()
    queries = dict(line.split(" ", 1) for line in (DEMO / "queries.txt").read_text().splitlines())
    name = sorted(queries)[0]
    crs = "EPSG:32632@" + ",".join(map(str, ORIGIN))
    command = [RAYLIFT, "serve", DEMO / "scene.toml", "--port", "0", "--crs", crs, "--cache", WORK / "cache",
               "--deadline", "600s"]
    with subprocess.Popen(list(map(str, command)), stdout=subprocess.PIPE, text=True) as server:
        try:
            answer = ask(server.stdout.readline().split()[-1], name, queries[name])
        finally:
            server.terminate()
    print(json.dumps(answer, indent=1))
    off_mm = [1e3 * error for error in errors(answer, name)]
    print(f"@oarc/gpp-access localized {name}, off by {off_mm[0]:.1f} mm east, {off_mm[1]:.1f} north, {off_mm[2]:.1f} up")
    assert max(map(abs, off_mm)) < 50 and answer["accuracy"]["position"] < 0.1


main()
