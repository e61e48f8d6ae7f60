"""What OpenCV finds in the pictures that `markers.rs` wrote (its folder is the argument). Needs opencv-python-headless and numpy."""

import csv
import math
import sys
import time
from collections import defaultdict
from pathlib import Path

import cv2
import numpy as np

SIDES_PX = [10, 15, 20, 30, 60, 150]
WRONG_PX = 5.0

folder = Path(sys.argv[1])
asked = defaultdict(list)
names = {}
with open(folder / "truth.csv") as rows:
    for row in csv.DictReader(rows):
        corners = np.array([[float(row[f"x{k}"]), float(row[f"y{k}"])] for k in range(4)])
        asked[int(row["picture"])].append((int(row["id"]), float(row["side_px"]), corners))
        names[int(row["picture"])] = row["condition"]

parameters = cv2.aruco.DetectorParameters()
parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
detector = cv2.aruco.ArucoDetector(dictionary, parameters)
tally = defaultdict(lambda: [0, 0, 0.0])
false_ones, took, pictures = defaultdict(int), 0.0, 0
for file in sorted(folder.glob("*.pgm"), key=lambda file: int(file.stem)):
    picture = int(file.stem)
    # Pictures of bare ground belong to the first condition; what follows them has rows again.
    name = names.get(picture, "bare ground or nothing whole in view")
    image = cv2.imread(str(file), cv2.IMREAD_GRAYSCALE)
    begin = time.perf_counter()
    found, ids, _ = detector.detectMarkers(image)
    took += time.perf_counter() - begin
    pictures += 1
    # OpenCV counts from the middle of the first pixel.
    found = [] if ids is None else [(int(i), c[0] + 0.5) for i, c in zip(ids.flatten(), found)]
    for marker, side, corners in asked[picture]:
        entry = tally[name, sum(side >= s for s in SIDES_PX)]
        entry[0] += 1
        offs = [(math.sqrt(np.mean(np.sum((c - corners) ** 2, axis=1))), k) for k, (i, c) in enumerate(found) if i == marker]
        if offs and min(offs)[0] < WRONG_PX:
            off, k = min(offs)
            entry[1] += 1
            entry[2] += off * off
            found.pop(k)
    whole = {marker for marker, _, _ in asked[picture]}
    false_ones[name] += sum(i not in (2, 7) or i in whole for i, _ in found)

print(f"{pictures} pictures, {1e3 * took / pictures:.1f} ms each")
for name in dict.fromkeys(list(names.values()) + list(false_ones)):
    print(f"{name}: {false_ones[name]} false ones")
    for side, (all_of, of_these, squares) in sorted((k[1], v) for k, v in tally.items() if k[0] == name):
        low = 0 if side == 0 else SIDES_PX[side - 1]
        print(f"  side from {low:>4} px: {of_these:>3} of {all_of:>3} found, corners {math.sqrt(squares / max(of_these, 1)):.2f} px")
