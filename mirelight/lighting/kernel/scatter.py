"""How light leaves a vertex: Lambert's law on the proxy, glTF's metallic-roughness model on inserted objects.

The model is that of the appendix B of glTF 2.0: a Trowbridge-Reitz (GGX) lobe with separable masking and shadowing over
a Lambert base, joined by Schlick's Fresnel term, whose reflectances are those of KHR_materials_specular and _ior. Over
all may lie the lobe of KHR_materials_clearcoat, weighted by Fresnel's term of the viewer's angle. Directions are drawn
from the normals that the viewer sees (Dupuy and Benyoub, "Sampling Visible GGX Normals with Spherical Caps", 2023).
"""

from __future__ import annotations

from typing import NamedTuple

import drjit as dr
import mitsuba as mi

from mirelight.lighting.kernel.fresnel import fresnel as schlick
from mirelight.lighting.kernel.fresnel import of_coat
from mirelight.lighting.kernel.proxy import Point
from mirelight.lighting.kernel.types import Bool, Float, Point2f, Vector3f

LEAST_ALPHA = 1e-3  # smoother surfaces have no lobe that single precision could hold
SCATTERED_ALPHA = 0.2  # least of mirrors that are met after a path has scattered: their caustics stay free of fireflies
LEAST_SHARE = 0.1  # of the samples that each lobe with any weight gets


class Coat(NamedTuple):
    """A clear coat over a vertex."""

    n: Vector3f  # shading normal, which maps do not turn
    alpha: Float
    weight: Float  # what it takes of the light below it
    share: Float  # of the samples that follow it


class Gloss(NamedTuple):
    """What decides how a vertex reflects, in world space; where `on` is false Lambert's law holds."""

    on: Bool  # it has more than Lambert's law
    n: Vector3f  # shading normal
    wo: Vector3f  # way to the viewer
    diffuse: Vector3f  # albedo of the base
    f0: Vector3f  # reflectance at normal incidence
    f90: Float  # and at grazing angles
    alpha: Float  # roughness squared
    share: Float  # of the samples that follow the lobe
    coat: Coat | None = None  # where there is any

    @staticmethod
    def of(at: Point, wo: Vector3f, base: Vector3f, least: Float) -> Gloss | None:
        """Of a point with a base colour: all of it is the base's where there is no object; None where there are none.

        `least`: alpha that no lobe is below.
        """
        finish, n = at.finish, at.normal
        if finish is None:
            return None
        on, metallic = finish.on, finish.metallic
        f0 = dr.select(on, dr.lerp(finish.specular, base, metallic), 0)
        f90 = dr.lerp(finish.weight, 1, metallic)
        below = base * (1 - metallic)
        if finish.transmission is not None:
            below = below * (1 - finish.transmission)
        diffuse = dr.select(on, below, base)
        seen = dr.maximum(dr.dot(n, wo), 1e-4)
        lobe = _mean(schlick(f0, f90, seen))
        rest = (1 - lobe) * _mean(diffuse)
        share = lobe / dr.maximum(lobe + rest, 1e-6)
        share = dr.select(rest > 0, dr.clip(share, LEAST_SHARE, 1 - LEAST_SHARE), 1)
        alpha = dr.maximum(dr.maximum(dr.square(finish.roughness), least), LEAST_ALPHA)
        coat: Coat | None = None
        if finish.coat is not None:
            over = n if at.smooth is None else at.smooth
            taken = of_coat(finish.coat, dr.clip(dr.dot(over, wo), 0, 1))
            taken = dr.select(on, taken, 0)
            followed = taken / dr.maximum(taken + (1 - taken) * (lobe + rest), 1e-6)
            followed = dr.select(taken > 0, dr.clip(followed, LEAST_SHARE, 1 - LEAST_SHARE), 0)
            coat = Coat(over, dr.maximum(finish.coat_alpha, least), taken, followed)
        return Gloss(on, n, wo, diffuse, f0, f90, alpha, dr.select(on, share, 0), coat)

    def alone(self, there: Bool) -> Gloss:
        """The lobe without its base where the law is on; nothing where there is no lobe."""
        f0, diffuse = dr.select(self.on & ~there, 0, self.f0), dr.select(self.on, 0, self.diffuse)
        return self._replace(f0=f0, diffuse=diffuse, share=dr.select(self.on, 1, 0))

    @dr.syntax
    def towards(self, wi: Vector3f) -> tuple[Vector3f, Float]:
        """(the BRDF of light from `wi`, 1/sr, 0 below the horizon of an object; density per solid angle of `drawn`).

        Packets of lanes where nothing is on are spared the lobe.
        """
        cosine = dr.dot(wi, self.n)
        value, pdf = self.diffuse * dr.inv_pi, dr.select(cosine > 0, cosine * dr.inv_pi, 0)
        if self.on:
            value, pdf = self._value(wi), self._pdf(wi)
        return value, pdf

    def _value(self, wi: Vector3f) -> Vector3f:
        """The BRDF where the law is on."""
        nl, nv, nh2, vh = self._cosines(wi, self.n)
        fresnel = schlick(self.f0, self.f90, vh)
        lobe = _normals(self.alpha, nh2) * _unmasked(self.alpha, nl) * _unmasked(self.alpha, nv) / (4 * nl * nv)
        shiny = (1 - fresnel) * self.diffuse * dr.inv_pi + fresnel * lobe
        if self.coat is not None:
            shiny = dr.lerp(shiny, mi.Vector3f(self._coat_lobe(self.coat, wi) / nl), self.coat.weight)
        return dr.select(dr.dot(wi, self.n) > 0, shiny, 0)

    def _pdf(self, wi: Vector3f) -> Float:
        """The density where the law is on."""
        cosine = dr.maximum(dr.dot(wi, self.n), 0)
        _, nv, nh2, _ = self._cosines(wi, self.n)
        lobe = _normals(self.alpha, nh2) * _unmasked(self.alpha, nv) / (4 * nv)
        density = dr.lerp(cosine * dr.inv_pi, lobe, self.share)
        if self.coat is not None:
            _, nv, nh2, _ = self._cosines(wi, self.coat.n)
            lobe = _normals(self.coat.alpha, nh2) * _unmasked(self.coat.alpha, nv) / (4 * nv)
            density = dr.lerp(density, lobe, self.coat.share)
        return dr.select(cosine > 0, density, 0)

    def _coat_lobe(self, coat: Coat, wi: Vector3f) -> Float:
        """The coat's lobe at full reflectance, times its own cosine."""
        nl, nv, nh2, _ = self._cosines(wi, coat.n)
        lobe = _normals(coat.alpha, nh2) * _unmasked(coat.alpha, nl) * _unmasked(coat.alpha, nv) / (4 * nv)
        return dr.select(dr.dot(wi, coat.n) > 0, lobe, 0)

    @dr.syntax
    def drawn(self, choice: Float, u: Point2f) -> tuple[Vector3f, Vector3f, Float]:
        """(a direction, by the lobe or by the cosine; BRDF times cosine over density there; the density, 0 below the
        horizon)."""
        wi = mi.Frame3f(self.n).to_world(mi.warp.square_to_cosine_hemisphere(u))
        if self.on:
            wi = self._sample(choice, u, wi)
        value, pdf = self.towards(wi)
        return wi, dr.select(pdf > 0, value * dr.maximum(dr.dot(wi, self.n), 0) / pdf, 0), pdf

    def _sample(self, choice: Float, u: Point2f, diffuse: Vector3f) -> Vector3f:
        """A direction where the law is on; `diffuse`: that by the cosine."""
        n, alpha, share = self.n, self.alpha, self.share
        if self.coat is not None:  # one number chooses twice
            coated, rest = choice < self.coat.share, (choice - self.coat.share) / (1 - self.coat.share)
            choice = dr.select(coated, 0, rest)
            n, alpha = dr.select(coated, self.coat.n, n), dr.select(coated, self.coat.alpha, alpha)
            share = dr.select(coated, 1, share)
        frame = mi.Frame3f(n)
        if self.coat is not None:
            diffuse = frame.to_world(mi.warp.square_to_cosine_hemisphere(u))
        v = frame.to_local(self.wo)
        v = dr.normalize(mi.Vector3f(v.x * alpha, v.y * alpha, dr.maximum(v.z, 1e-4)))
        sin_phi, cos_phi = dr.sincos(dr.two_pi * u.y)
        z = dr.fma(1 - u.x, 1 + v.z, -v.z)
        r = dr.safe_sqrt(1 - z * z)
        h = mi.Vector3f(r * cos_phi, r * sin_phi, z) + v
        h = frame.to_world(dr.normalize(mi.Vector3f(h.x * alpha, h.y * alpha, h.z)))
        mirrored = h * (2 * dr.dot(self.wo, h)) - self.wo
        return dr.select(choice < share, mirrored, diffuse)

    def _cosines(self, wi: Vector3f, n: Vector3f) -> tuple[Float, Float, Float, Float]:
        """n·l, n·v, sin² of the angle between n and h, v·h."""
        h = wi + self.wo
        length2 = dr.squared_norm(h)
        h = h * dr.select(length2 > 1e-12, dr.rsqrt(length2), 0)
        sine2 = dr.squared_norm(dr.cross(n, h))  # not 1 - cos², which near a mirror's peak is all rounding
        nl, nv = dr.maximum(dr.dot(n, wi), 1e-4), dr.maximum(dr.dot(n, self.wo), 1e-4)
        return nl, nv, sine2, dr.clip(dr.dot(self.wo, h), 0, 1)


def _mean(color: Vector3f) -> Float:
    """Over the channels. `dr.mean` writes the number of lanes into the kernel: another for each size of a picture."""
    return dr.sum(color) * (1 / 3)


def _normals(alpha: Float, sine2: Float) -> Float:
    """D, the density of microscopic normals, by sin² of their angle to n."""
    a2 = dr.square(alpha)
    return a2 * dr.inv_pi / dr.square(a2 + sine2 * (1 - a2))


def _unmasked(alpha: Float, cosine: Float) -> Float:
    """G1, the share of a direction's normals that nothing hides."""
    a2 = dr.square(alpha)
    return 2 * cosine / (cosine + dr.sqrt(a2 + (1 - a2) * dr.square(cosine)))


def towards(gloss: Gloss | None, cosine: Float, wi: Vector3f) -> tuple[Vector3f | None, Float]:
    """(what of the BRDF a vertex' `weight` has not: where objects are, all of it, else None; density per solid angle
    with which a path goes on that way, whose cosine is above 0)."""
    return (None, cosine * dr.inv_pi) if gloss is None else gloss.towards(wi)


def reflected(irradiance: Vector3f, value: Vector3f | None) -> Vector3f:
    """Irradiance from one direction times what `towards` says."""
    return irradiance if value is None else irradiance * value
