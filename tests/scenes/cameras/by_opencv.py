"""Images of calibrated cameras by OpenCV, whose pixel centers are at integers."""

import cv2
import numpy as np


def given_of(camera):
    """Camera matrix, coefficients, and the functions for its kind of lens."""
    matrix = np.array([[camera.fx_px, 0, camera.cx_px], [0, camera.fy_px, camera.cy_px], [0, 0, 1]])
    lens = np.array(camera.fisheye or camera.distortion or [0.0] * 5)
    return matrix, lens, cv2.fisheye if camera.fisheye else cv2


def opencv_points(camera, points):
    """Image points (n, 2) of points (n, 3) in camera axes."""
    matrix, lens, kind = given_of(camera)
    still = np.zeros(3)
    return kind.projectPoints(points[:, None], still, still, matrix, lens)[0][:, 0]


def undistortion_map(camera):
    matrix, lens, kind = given_of(camera)
    size = camera.width, camera.height
    found = kind.initUndistortRectifyMap(matrix, lens, np.eye(3), matrix, size, cv2.CV_32FC1)
    return np.dstack(found)
