"""Finds red discs as one does with OpenCV, in pictures of 160 by 120 from standard input: four bytes of the radius expected, then
the pixels. Prints [x, y] or null for each, by two ways: Hough's circles in the mask, and the roundest contour of the mask.

The white is balanced (grey world), the mask is closed and opened; sizes of half to one and a half of the expected are taken."""

import json
import struct
import sys

import cv2
import numpy

WIDTH, HEIGHT = 160, 120


def mask_of(rgb):
    bright = rgb.astype(numpy.float32)
    means = bright.reshape(-1, 3).mean(axis=0)
    balanced = numpy.clip(bright * (means.mean() / numpy.maximum(means, 1.0)), 0, 255).astype(numpy.uint8)
    smooth = cv2.GaussianBlur(balanced, (3, 3), 0)
    hsv = cv2.cvtColor(smooth, cv2.COLOR_RGB2HSV)
    low = cv2.inRange(hsv, (0, 100, 30), (10, 255, 255))
    high = cv2.inRange(hsv, (165, 100, 30), (180, 255, 255))
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (3, 3))
    mask = cv2.morphologyEx(low | high, cv2.MORPH_CLOSE, kernel)
    return cv2.morphologyEx(mask, cv2.MORPH_OPEN, kernel)


def by_hough(mask, radius):
    least, most = max(3, int(0.6 * radius)), int(1.3 * radius) + 2
    found = cv2.HoughCircles(
        cv2.GaussianBlur(mask, (5, 5), 0), cv2.HOUGH_GRADIENT, 1.0, 20, param1=100, param2=12, minRadius=least, maxRadius=most
    )
    if found is None:
        return None
    for x, y, r in found.reshape(-1, 3)[:5]:
        disc = numpy.zeros_like(mask)
        cv2.circle(disc, (int(round(x)), int(round(y))), int(round(r)), 255, -1)
        if cv2.mean(mask, disc)[0] > 0.6 * 255:
            return [float(x) + 0.5, float(y) + 0.5]
    return None


def by_contour(mask, radius):
    best = None
    for contour in cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)[0]:
        area, length = cv2.contourArea(contour), cv2.arcLength(contour, True)
        (x, y), r = cv2.minEnclosingCircle(contour)
        if len(contour) < 8 or not 0.6 * radius - 1 < r < 1.4 * radius + 2:
            continue
        score = min(4 * numpy.pi * area / length**2, area / (numpy.pi * r * r))
        if score > 0.55 and (best is None or score > best[0]):
            best = (score, [float(x) + 0.5, float(y) + 0.5])
    return best and best[1]


def main():
    hough, contour = [], []
    size = 4 + 3 * WIDTH * HEIGHT
    while len(case := sys.stdin.buffer.read(size)) == size:
        (radius,) = struct.unpack("<f", case[:4])
        mask = mask_of(numpy.frombuffer(case, numpy.uint8, offset=4).reshape(HEIGHT, WIDTH, 3))
        hough.append(by_hough(mask, radius))
        contour.append(by_contour(mask, radius))
    print(json.dumps({"hough": hough, "contour": contour}))


main()
