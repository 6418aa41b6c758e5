"""Pixels that are the mean of several: frames smaller than the pictures that splats were trained on.

A splat is widened by a part of a pixel, and was trained so; in a frame with larger pixels it comes out too wide, and
what lies between pixels' middles is missed (Yu et al., "Mip-Splatting", 2024).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mirelight.base.colour import srgb_decode, srgb_encode
from mirelight.model import F32, Camera, SplatLayer


def finer(camera: Camera, count: int) -> Camera:
    """The camera with so many pixels in the place of one, along each axis."""
    return camera.resized(count * camera.width, count * camera.height)


def reduced(layer: SplatLayer, camera: Camera, count: int) -> SplatLayer:
    """A layer of :func:`finer` at the camera's size: means of light and of transmittance, depths of what shows."""
    alpha = 1 - layer.transmittance
    covered = mean(alpha, count)
    diffuse = None if layer.diffuse is None else mean_color(layer.diffuse, layer, count)
    depth = np.divide(mean(layer.depth * alpha, count), covered, out=np.zeros_like(covered), where=covered > 0)
    there = (layer.median_depth > 0).astype(np.float32)
    share = mean(there, count)
    median = np.divide(mean(layer.median_depth, count), share, out=np.zeros_like(share), where=share >= 0.5)
    return replace(
        layer,
        camera=camera,
        color=mean_color(layer.color, layer, count),
        transmittance=mean(layer.transmittance, count),
        depth=depth,
        median_depth=median,
        diffuse=diffuse,
    )


def mean_color(color: F32, layer: SplatLayer, count: int) -> F32:
    """(H, W, 3) of colours of a finer layer, premultiplied, in its space: the mean of their light."""
    if layer.linear:
        return mean(color, count)
    alpha = (1 - layer.transmittance)[..., None]
    straight = np.divide(color, alpha, out=np.zeros_like(color), where=alpha > 0)
    light, covered = mean(srgb_decode(straight) * alpha, count), mean(alpha, count)
    straight = np.divide(light, covered, out=np.zeros_like(light), where=covered > 0)
    return np.asarray(srgb_encode(straight) * covered, np.float32)


def mean(image: F32, count: int) -> F32:
    """(H, W, ...) of an image (count H, count W, ...)."""
    height, width = image.shape[0] // count, image.shape[1] // count
    parts = image.reshape(height, count, width, count, *image.shape[2:])
    return np.asarray(parts.mean(axis=(1, 3), dtype=np.float32), np.float32)
