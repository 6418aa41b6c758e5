"""The same cloud through Mitsuba's own `ellipsoids` shape: a ray tracer of Gaussian volumes, for the benchmark."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from mirelight.base import backend
from mirelight.model import F32, Camera, SplatCloud


def renderer(splats: SplatCloud, camera: Camera) -> Callable[[], F32]:
    """A call that renders (H, W, 3) of a centred perspective camera, one sample a pixel.

    Its Gaussians are evaluated along rays in 3D, so that the picture is like the rasterised one but not equal.
    """
    mi = backend.mitsuba("llvm_ad_rgb")
    scene = mi.load_dict(
        {
            "type": "scene",
            "integrator": {"type": "volprim_rf_basic", "max_depth": 64, "srgb_primitives": False},  # blend as encoded
            "sensor": {
                "type": "perspective",
                "fov": float(np.degrees(2 * np.arctan(camera.height / (2 * camera.fy)))),
                "fov_axis": "y",
                "to_world": mi.ScalarTransform4f((camera.world_from_camera @ np.diag([-1.0, 1.0, -1.0, 1.0])).tolist()),
                "film": {
                    "type": "hdrfilm",
                    "width": camera.width,
                    "height": camera.height,
                    "rfilter": {"type": "box"},
                    "pixel_format": "rgb",
                },
            },
            "cloud": {
                "type": "ellipsoids",
                "centers": mi.TensorXf(splats.means),
                "scales": mi.TensorXf(splats.scales),
                "quaternions": mi.TensorXf(np.roll(splats.quats, -1, axis=1)),
                "opacities": mi.TensorXf(splats.opacities[:, None]),
                "sh_coeffs": mi.TensorXf(splats.sh.reshape(len(splats), -1)),
            },
        }
    )
    return lambda: np.asarray(mi.render(scene, spp=1), dtype=np.float32)
