"""Draws pads, and things that are none, with OpenCV: a renderer that knows nothing of ours. To standard output goes, for each picture of
160 by 120, a byte that says whether it shows a pad, the height in four bytes, and the pixels."""

import itertools
import math
import struct
import sys

import cv2
import numpy

WIDTH, HEIGHT, FINER = 160, 120, 4
FOCAL_PX, PAD_M = 0.866 * WIDTH, 0.25
GROUNDS = [(50, 120, 60), (128, 128, 128), (240, 240, 240), (15, 15, 15), (200, 180, 150), (130, 90, 60)]
REDS = [(255, 0, 0), (140, 20, 20), (200, 30, 40), (170, 40, 40)]


def draw(picture, shape, centre, radius, red):
    whole = (int(radius), int(radius))
    if shape == "disc":
        cv2.circle(picture, centre, int(radius), red, -1)
    elif shape == "square":
        half = int(0.9 * radius)
        cv2.rectangle(picture, (centre[0] - half, centre[1] - half), (centre[0] + half, centre[1] + half), red, -1)
    elif shape == "half":
        cv2.ellipse(picture, centre, whole, 20, 0, 180, red, -1)
    elif shape == "ring":
        cv2.circle(picture, centre, int(radius), red, max(1, int(0.35 * radius)))
    elif shape == "triangle":
        corners = [(0.3 + k * math.tau / 3) for k in range(3)]
        points = [(centre[0] + 1.3 * radius * math.cos(a), centre[1] + 1.3 * radius * math.sin(a)) for a in corners]
        cv2.fillPoly(picture, [numpy.array(points, numpy.int32)], red)


def main():
    random = numpy.random.default_rng(1)
    shapes = ["disc", "square", "half", "ring", "triangle"]
    for shape, ground, red, height_m, noise in itertools.product(shapes, GROUNDS, REDS, [0.8, 1.5, 3.0, 4.5], [0, 6]):
        picture = numpy.full((HEIGHT * FINER, WIDTH * FINER, 3), ground, numpy.uint8)
        x, y = random.uniform(0.35, 0.65, 2)
        centre = (int(x * WIDTH * FINER), int(y * HEIGHT * FINER))
        draw(picture, shape, centre, FOCAL_PX * PAD_M / height_m * FINER, red)
        small = cv2.resize(picture, (WIDTH, HEIGHT), interpolation=cv2.INTER_AREA).astype(float)
        noisy = numpy.clip(small + random.normal(0, noise, small.shape), 0, 255).astype(numpy.uint8)
        sys.stdout.buffer.write(struct.pack("<Bf", shape == "disc", height_m) + noisy.tobytes())


main()
