"""How light leaves a vertex: Lambert's law on the proxy, glTF's metallic-roughness model on inserted objects.

The model is that of the appendix B of glTF 2.0: a Trowbridge-Reitz (GGX) lobe with separable masking and shadowing over
a Lambert base, joined by Schlick's Fresnel term. Directions are drawn from the normals that the viewer sees (Dupuy and
Benyoub, "Sampling Visible GGX Normals with Spherical Caps", 2023).
"""

from __future__ import annotations

from typing import NamedTuple

import drjit as dr
import mitsuba as mi

from mirelight.lighting.kernel.types import Bool, Float, Point2f, Vector3f

DIELECTRIC = 0.04  # reflectance at normal incidence of what is no metal (an index of refraction of 1.5)
LEAST_ALPHA = 1e-3  # smoother surfaces have no lobe that single precision could hold
SCATTERED_ALPHA = 0.2  # least of mirrors that are met after a path has scattered: their caustics stay free of fireflies
LEAST_SHARE = 0.1  # of the samples that each lobe with any weight gets


class Gloss(NamedTuple):
    """What decides how a vertex reflects, in world space; where `on` is false Lambert's law holds."""

    on: Bool  # of an inserted object
    n: Vector3f  # shading normal
    wo: Vector3f  # way to the viewer
    diffuse: Vector3f  # albedo of the base
    f0: Vector3f  # reflectance at normal incidence
    alpha: Float  # roughness squared
    share: Float  # of the samples that follow the lobe

    @staticmethod
    def of(on: Bool, n: Vector3f, wo: Vector3f, base: Vector3f, metallic: Float, alpha: Float) -> Gloss:
        """From a base colour: all of it is the base's where there is no object."""
        f0 = dr.select(on, dr.lerp(mi.Vector3f(DIELECTRIC), base, metallic), 0)
        diffuse = dr.select(on, base * (1 - metallic), base)
        seen = dr.maximum(dr.dot(n, wo), 1e-4)
        lobe = dr.mean(_fresnel(f0, seen))
        below = (1 - lobe) * dr.mean(diffuse)
        share = lobe / dr.maximum(lobe + below, 1e-6)
        share = dr.select(below > 0, dr.clip(share, LEAST_SHARE, 1 - LEAST_SHARE), 1)
        return Gloss(on, n, wo, diffuse, f0, dr.maximum(alpha, LEAST_ALPHA), dr.select(on, share, 0))

    def value(self, wi: Vector3f) -> Vector3f:
        """The BRDF of light from `wi`, 1/sr; 0 below the horizon of an object."""
        nl, nv, nh2, vh = self._cosines(wi)
        fresnel = _fresnel(self.f0, vh)
        lobe = self._normals(nh2) * self._unmasked(nl) * self._unmasked(nv) / (4 * nl * nv)
        shiny = (1 - fresnel) * self.diffuse * dr.inv_pi + fresnel * lobe
        return dr.select(self.on, dr.select(dr.dot(wi, self.n) > 0, shiny, 0), self.diffuse * dr.inv_pi)

    def pdf(self, wi: Vector3f) -> Float:
        """Density per solid angle of `sample`."""
        cosine = dr.maximum(dr.dot(wi, self.n), 0)
        _, nv, nh2, _ = self._cosines(wi)
        lobe = self._normals(nh2) * self._unmasked(nv) / (4 * nv)
        return dr.select(cosine > 0, dr.lerp(cosine * dr.inv_pi, lobe, self.share), 0)

    def sample(self, choice: Float, u: Point2f) -> Vector3f:
        """A direction, by the lobe or by the cosine; it may lie below the horizon, where `pdf` is 0."""
        frame = mi.Frame3f(self.n)
        diffuse = frame.to_world(mi.warp.square_to_cosine_hemisphere(u))
        v = frame.to_local(self.wo)
        v = dr.normalize(mi.Vector3f(v.x * self.alpha, v.y * self.alpha, dr.maximum(v.z, 1e-4)))
        sin_phi, cos_phi = dr.sincos(dr.two_pi * u.y)
        z = dr.fma(1 - u.x, 1 + v.z, -v.z)
        r = dr.safe_sqrt(1 - z * z)
        h = mi.Vector3f(r * cos_phi, r * sin_phi, z) + v
        h = frame.to_world(dr.normalize(mi.Vector3f(h.x * self.alpha, h.y * self.alpha, h.z)))
        mirrored = h * (2 * dr.dot(self.wo, h)) - self.wo
        return dr.select(choice < self.share, mirrored, diffuse)

    def weight(self, wi: Vector3f) -> Vector3f:
        """What a path that goes on along a drawn direction is multiplied by: BRDF times cosine over density."""
        pdf = self.pdf(wi)
        return dr.select(pdf > 0, self.value(wi) * dr.maximum(dr.dot(wi, self.n), 0) / pdf, 0)

    def _cosines(self, wi: Vector3f) -> tuple[Float, Float, Float, Float]:
        """n·l, n·v, sin² of the angle between n and h, v·h."""
        h = wi + self.wo
        length2 = dr.squared_norm(h)
        h = h * dr.select(length2 > 1e-12, dr.rsqrt(length2), 0)
        sine2 = dr.squared_norm(dr.cross(self.n, h))  # not 1 - cos², which near a mirror's peak is all rounding
        nl, nv = dr.maximum(dr.dot(self.n, wi), 1e-4), dr.maximum(dr.dot(self.n, self.wo), 1e-4)
        return nl, nv, sine2, dr.clip(dr.dot(self.wo, h), 0, 1)

    def _normals(self, sine2: Float) -> Float:
        """D, the density of microscopic normals, by sin² of their angle to n."""
        a2 = dr.square(self.alpha)
        return a2 * dr.inv_pi / dr.square(a2 + sine2 * (1 - a2))

    def _unmasked(self, cosine: Float) -> Float:
        """G1, the share of a direction's normals that nothing hides."""
        a2 = dr.square(self.alpha)
        return 2 * cosine / (cosine + dr.sqrt(a2 + (1 - a2) * dr.square(cosine)))


def reflected(gloss: Gloss | None, irradiance: Vector3f, wi: Vector3f) -> Vector3f:
    """Irradiance from one direction times what of the BRDF a vertex' `weight` has not: where objects are, all of it."""
    return irradiance if gloss is None else irradiance * gloss.value(wi)


def density(gloss: Gloss | None, cosine: Float, wi: Vector3f) -> Float:
    """Per solid angle, with which a path goes on that way; the cosine is above 0."""
    return cosine * dr.inv_pi if gloss is None else gloss.pdf(wi)


def _fresnel(f0: Vector3f, cosine: Float) -> Vector3f:
    """Schlick's approximation; nothing where `f0` is 0."""
    away = 1 - cosine
    rise = dr.square(dr.square(away)) * away
    return dr.select(dr.max(f0) > 0, f0 + (1 - f0) * rise, 0)
