"""Light in the studio: early light of a few splats is near fine light of all, comes before it, and gives way to it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from mirelight.apps.mixer import rgb9e5
from mirelight.apps.studio import early, opened
from mirelight.apps.studio.lights import Layer
from mirelight.apps.studio.session import Session
from mirelight.apps.studio.worker import Ordered
from mirelight.estimate import Confidence, Estimate
from mirelight.io import splats
from mirelight.io.gltf.write import write_glb
from mirelight.model import ProxyMesh, triangles
from mirelight.pipeline.scene import prepare

from .mixer_scene import walls

JOB = """
splats = "corner.ply"
proxy = { path = "proxy.glb", albedo = "splats" }
captured = { environment = { radiance = 1 } }
lights = [{ type = "sun", elevation = 40, azimuth = 200, intensity = 3, angular_diameter = 4 }]
environment = { radiance = 0.4 }
"""


def even(radiance: float) -> Estimate:
    """An estimate that is sure of light from all around."""
    trust = Confidence(
        places=500,
        blocked=0.4,
        scale_known=True,
        sun_gain=0.0,
        sun_apart=float("nan"),
        sun_beaten=float("nan"),
        sun_disc=(0.0, 0.0),
        halves_apart=0.01,
        held_out=0.5,
        lamps_gain=(),
        albedo=(0.1, 0.3, 0.7),
    )
    return Estimate(
        to_sun=np.array([0.0, 1, 0]),
        sun=np.zeros(3),
        sun_diameter=0.53,
        named=(),
        lamps=np.zeros((0, 6)),
        radiance=np.full((48, 96, 3), radiance),
        confidence=trust,
    )


def shown(layers: tuple[Layer, ...]) -> NDArray[np.float64]:
    """(N, 3) what the page multiplies the splats by."""
    values = [rgb9e5.decode(np.frombuffer(x.packed, "<u4")) * (x.scale * x.weight) for x in layers]
    return np.asarray(np.sum(values, axis=0))


def test_early_light_comes_first_and_is_near_fine_light(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    cloud, proxy = walls(40)
    splats.write(cloud, tmp_path / "corner.ply")
    write_glb(tmp_path / "proxy.glb", proxy, (), ())
    (tmp_path / "job.toml").write_text(JOB)
    (tmp_path / "page").mkdir()
    monkeypatch.setattr(early, "FEW", 600)
    session = Session(opened(tmp_path / "job.toml", None), tmp_path / "page")
    session._lights.warm(session._scene)  # as while a proxy is made: nothing of it is shown or kept
    assert session._lights.best is None and not session.state().tracing
    session._phase = "ready"  # as its proxy is a file
    asked: list[Ordered] = []
    monkeypatch.setattr(session, "_help", lambda order, line: asked.append(order))
    while session._step():
        pass
    first = session.state()
    assert [x.samples for x in first.layers] == [early.SAMPLES] * 3 and len(asked) == 1 and not first.trouble
    early.make(prepare(session.document.job(asked[0].text), session._store.artefacts))  # what the other process does
    while session._step() and session.state().layers[0].samples < 64:
        pass
    last = session.state()
    assert [x.version for x in last.layers] > [x.version for x in first.layers]
    a, b = shown(first.layers), shown(last.layers)
    assert np.abs(a.mean() / b.mean() - 1) < 0.08  # the proxy is grey at first
    assert np.quantile(np.abs(a - b) / b.mean(), 0.9) < 0.2
    assert first.level == pytest.approx(last.level, rel=0.1)
    session.run(lambda: True)


def test_an_estimate_is_shown_as_a_lighting(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Once another process has found it: splats look as they were captured, by early and by fine light."""
    cloud, proxy = walls(40)
    splats.write(cloud, tmp_path / "corner.ply")
    write_glb(tmp_path / "proxy.glb", proxy, (), ())
    text = JOB[: JOB.index("captured")] + 'captured = "estimate"\nlightings = ["captured"]\n'
    (tmp_path / "job.toml").write_text(text)
    (tmp_path / "page").mkdir()
    monkeypatch.setattr(early, "FEW", 600)
    monkeypatch.setattr("mirelight.estimate.estimate", None)  # not called here
    session = Session(opened(tmp_path / "job.toml", None), tmp_path / "page")
    session._phase = "ready"
    monkeypatch.setattr(session, "_help", lambda order, line: None)
    assert not session._step()
    waits = session.state()
    assert not waits.layers and not waits.trouble and waits.around[0] == 0
    monkeypatch.setattr("mirelight.estimate.estimate", lambda *_: even(2.0))
    scene = prepare(session._job, session._store.artefacts)
    assert scene.job.captured is not None
    scene.resolved(scene.job.captured)
    monkeypatch.setattr("mirelight.estimate.estimate", None)
    while session._step():
        pass
    first = session.state()
    assert first.layers[0].samples == early.SAMPLES and first.around[0] == 1 and not first.trouble
    early.make(scene)
    while session._step() and session.state().layers[0].samples < 64:
        pass
    last = session.state()
    assert last.layers[0].samples > early.SAMPLES and not last.trouble
    for found in (first, last):
        assert np.median(shown(found.layers)) == pytest.approx(1, abs=0.02)
    session.run(lambda: True)


def test_a_mesh_of_many_triangles_is_made_coarse(monkeypatch: pytest.MonkeyPatch) -> None:
    """A bumpy sheet keeps its place and its extent."""
    monkeypatch.setattr(early, "MOST_FACES", 50_000)
    side = 300
    x, z = (v.ravel() for v in np.meshgrid(np.linspace(0, 2, side), np.linspace(0, 2, side)))
    a = (np.arange(side - 1)[:, None] * side + np.arange(side - 1)).ravel()
    b, c, d = a + side, a + 1, a + side + 1
    faces = np.concatenate([np.stack(v, axis=1) for v in ((a, b, c), (c, b, d))])
    vertices = np.stack([x, 0.1 * np.sin(9 * x), z], axis=1).astype(np.float32)
    made = early._coarse(ProxyMesh(vertices=vertices, faces=faces.astype(np.int32)))
    assert 5_000 < len(made.faces) <= 50_000
    np.testing.assert_allclose(made.bounds, [[0, -0.1, 0], [2, 0.1, 2]], atol=0.02)
    assert np.abs(made.vertices[:, 1] - 0.1 * np.sin(9 * made.vertices[:, 0])).max() < 0.01
    areas = [triangles.areas(v[f]).sum() for v, f in ((made.vertices, made.faces), (vertices, faces))]
    assert areas[0] == pytest.approx(areas[1], rel=0.02)
