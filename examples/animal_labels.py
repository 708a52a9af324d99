"""Draw an animal of ellipsoids that a camera sees directly and in two mirrors, with labels as DeepLabCut writes them.

    python examples/animal_labels.py [OUT]

Some labels are wrong. docs/animals.md calibrates the mirrors from them; OUT/truth.csv has the points.
"""

import sys
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from mirrorcam import Camera
from mirrorcam.core.images.pictures import write_image
from mirrorcam.optics.geometry.mirror import reflect

CAMERA = Camera(width_px=640, height_px=480, fx_px=700.0, fy_px=701.0, cx_px=322.0, cy_px=238.0)
CENTRES = np.array([[-725.0, 18.6, 576.3], [717.1, 27.9, 596.0]])  # virtual cameras of the mirrors, mm
EDGES = (225, 415)  # columns between the left mirror, the direct view, and the right mirror
# Centre, radii (mm) and brightness of ellipsoids; the animal walks along y, and turns its back (-z) to the camera.
PARTS = [((0, 0, 0), (15, 32, 13), 130), ((0, 38, 2), (9, 15, 9), 150), ((0, -50, 5), (3, 22, 3), 170)]
PARTS += [((side * 9, 30, -7), (5, 3, 6), 190) for side in (-1, 1)]
PARTS += [((side * 13, y, 12), (4, 6, 4), 220) for side in (-1, 1) for y in (-20, 20)]
LABELS = {"nose": (0, 53, 2), "tail": (0, -72, 5), "ear_l": (-9, 30, -13), "ear_r": (9, 30, -13)}
LABELS |= {"paw_fl": (-13, 26, 12), "paw_fr": (13, 26, 12), "paw_hl": (-13, -26, 12), "paw_hr": (13, -26, 12)}
# Rays of all pixels; those in a mirror start from its virtual camera.
column, row = np.meshgrid(np.arange(CAMERA.width_px), np.arange(CAMERA.height_px))
rays, origins = CAMERA.unproject(np.stack([column, row], axis=-1)), np.zeros((*column.shape, 3))
for centre, inside in zip(CENTRES, (column < EDGES[0], column > EDGES[1]), strict=True):
    origins[inside], rays[inside] = centre, reflect(rays[inside], centre) - centre
out = Path(sys.argv[1] if len(sys.argv) > 1 else "output/examples/animal")
random = np.random.default_rng(1)
names = [f"{name}_{view}" for view in ("direct", "left", "right") for name in LABELS for _ in "xy"]
labels = [["scorer", *["me"] * len(names)], ["bodyparts", *names], ["coords", *["x", "y"] * (len(names) // 2)]]
truth = [["frame", "label", "x_mm", "y_mm", "z_mm"]]
for frame in [f"img{number:03d}.png" for number in range(60)]:
    position, turned = (
        random.uniform((-15, -80, 580), (15, 80, 620)),
        Rotation.from_euler("z", random.uniform(-0.4, 0.4)),
    )
    points = turned.apply(list(LABELS.values())) + position
    truth += [[frame, name, *point] for name, point in zip(LABELS, points.tolist(), strict=True)]
    pixels = CAMERA.project(np.stack([points, *(reflect(points, centre) for centre in CENTRES)]))
    pixels += random.normal(0, 1, pixels.shape)  # px
    wrong = random.uniform(size=pixels.shape[:2]) < 0.1
    pixels[wrong] = random.uniform((0, 0), (CAMERA.width_px, CAMERA.height_px), (wrong.sum(), 2))
    labels.append([frame, *np.round(pixels.ravel(), 2).tolist()])
    if frame < "img003.png":
        grey, nearest = np.where(origins.any(axis=-1), 70.0, 40.0), np.full(column.shape, np.inf)
        for centre, radii, brightness in PARTS:  # each a unit sphere in its own frame
            start = ((origins - position) @ turned.as_matrix() - centre) / radii
            along = rays @ turned.as_matrix() / radii
            a, b, c = (np.sum(x * y, axis=-1) for x, y in ((along, along), (along, start), (start, start)))
            distance = (-b - np.sqrt(np.maximum(b**2 - a * (c - 1), 0))) / a
            hit = (b**2 > a * (c - 1)) & (distance < nearest)
            grey[hit], nearest[hit] = (brightness * (1.4 - 0.6 * np.sqrt(c - b**2 / a)))[hit] / 1.4, distance[hit]
        write_image(out / frame, np.repeat(grey[..., None], 3, axis=2).astype(np.uint8))
for file, table in (("labels.csv", labels), ("truth.csv", truth)):
    (out / file).write_text("".join(",".join(map(str, line)) + "\n" for line in table))
