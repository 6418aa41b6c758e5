// The page that a program opens: renders the scene once and sends every buffer back by PUT, bottom row first.
import * as pc from 'playcanvas';
import { build, splatFiles } from './scene.mjs';

const SETTLING_FRAMES = 4;  // sorting runs in a worker and its result is used in a later frame

const frames = (app, count) => new Promise((resolve) => {
    const handle = app.on('frameend', () => { if (--count <= 0) { handle.off(); resolve(); } });
});

function splatsReady(app, description) {
    if (splatFiles(description).length === 0) return Promise.resolve();
    return new Promise((resolve) => {
        const handle = app.systems.gsplat.on('frame:ready', (camera, layer, ready, loading) => {
            if (ready && loading === 0) { handle.off(); resolve(); }
        });
    });
}

// Every pixel of a texture as RGBA float, through a framebuffer of our own.
function readTexture(device, texture) {
    const gl = device.gl;
    const pixels = new Float32Array(4 * texture.width * texture.height);
    const before = gl.getParameter(gl.FRAMEBUFFER_BINDING);
    const framebuffer = gl.createFramebuffer();
    gl.bindFramebuffer(gl.FRAMEBUFFER, framebuffer);
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, texture.impl._glTexture, 0);
    gl.readPixels(0, 0, texture.width, texture.height, gl.RGBA, gl.FLOAT, pixels);
    gl.bindFramebuffer(gl.FRAMEBUFFER, before);
    gl.deleteFramebuffer(framebuffer);
    return pixels;
}

function readBackBuffer(device) {
    const gl = device.gl;
    const pixels = new Uint8Array(4 * device.width * device.height);
    const before = gl.getParameter(gl.FRAMEBUFFER_BINDING);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    gl.readPixels(0, 0, device.width, device.height, gl.RGBA, gl.UNSIGNED_BYTE, pixels);
    gl.bindFramebuffer(gl.FRAMEBUFFER, before);
    return pixels;
}

const send = (name, body) => fetch(`captured/${name}`, { method: 'PUT', body });
const rows = (matrix) => [0, 1, 2, 3].map((r) => [0, 1, 2, 3].map((c) => matrix.data[4 * c + r]));

const formatName = (format) => {
    const name = Object.keys(pc).find((key) => key.startsWith('PIXELFORMAT_') && pc[key] === format);
    return name?.replace('PIXELFORMAT_', '') ?? String(format);
};

function floatTarget(device) {
    const colorBuffer = new pc.Texture(device, {
        name: 'FloatFrame', width: device.width, height: device.height, format: pc.PIXELFORMAT_RGBA32F,
        mipmaps: false, minFilter: pc.FILTER_NEAREST, magFilter: pc.FILTER_NEAREST
    });
    return new pc.RenderTarget({ name: 'FloatFrame', colorBuffer, depth: true });
}

// Directs the frame into a float target: the camera's own in the gamma pipeline, the scene texture in the linear one.
function intoFloat(view) {
    if (view.frame) {
        view.frame.rendering.renderFormats = [pc.PIXELFORMAT_RGBA32F];
        view.frame.update();
        return () => view.frame.renderPassCamera.rt.colorBuffer;
    }
    const target = floatTarget(view.app.graphicsDevice);
    view.camera.camera.renderTarget = target;
    return () => target.colorBuffer;
}

function meta(view, description) {
    const { app, camera, relighting, lights } = view;
    const device = app.graphicsDevice;
    const component = camera.camera;
    const debug = device.gl.getExtension('WEBGL_debug_renderer_info');
    const splats = app.root.find((entity) => entity.gsplat?.asset);
    const counts = splats.map((entity) => app.assets.get(entity.gsplat.asset)?.resource?.numSplats ?? 0);
    return {
        engine: { version: pc.version, revision: pc.revision },
        gl: { renderer: debug ? device.gl.getParameter(debug.UNMASKED_RENDERER_WEBGL) : '', version: device.gl.getParameter(device.gl.VERSION) },
        width: device.width, height: device.height,
        pipeline: description.pipeline ?? 'gamma', toneMapping: description.toneMapping ?? 'none',
        camera: {
            view: rows(component.viewMatrix), projection: rows(component.projectionMatrix), world: rows(camera.getWorldTransform()),
            fov: component.fov, near: component.nearClip, far: component.farClip
        },
        relight: {
            width: relighting.texture.width, height: relighting.texture.height, blend: relighting.blend,
            brightness: relighting.brightness, background: relighting.background
        },
        splats: counts.reduce((sum, count) => sum + count, 0),
        gsplat: { dataFormat: app.scene.gsplat.dataFormat, radialSorting: app.scene.gsplat.radialSorting },
        lights: lights.map((entity) => ({
            name: entity.name, type: entity.light.type, position: entity.getPosition().toArray(),
            direction: entity.up.mulScalar(-1).toArray(), colorLinear: Array.from(entity.light.light._colorLinear),
            penumbraSize: entity.light.light.penumbraSize, penumbraFalloff: entity.light.light.penumbraFalloff,
            range: entity.light.range, falloffMode: entity.light.falloffMode, castShadows: entity.light.castShadows
        })),
        clusteredLighting: app.scene.clusteredLightingEnabled, physicalUnits: app.scene.physicalUnits,
        hdrFormat: view.frame ? formatName(view.frame.renderPassCamera.rt.colorBuffer.format) : null
    };
}

async function capture() {
    await send('said', 'loading the scene');
    const description = await (await fetch('scene.json')).json();
    const view = await build(document.getElementById('view'), description);
    const { app, relighting } = view;
    const device = app.graphicsDevice;
    const settled = () => frames(app, SETTLING_FRAMES);
    const blend = relighting.blend;

    await send('said', 'sorting the splats, drawing shadow maps');
    await splatsReady(app, description);
    await settled();
    await send('frame', readBackBuffer(device));
    await send('relight', readTexture(device, relighting.texture));
    await send('meta', JSON.stringify(meta(view, description)));
    await send('said', 'rendering without light');
    relighting.blend = 0;
    await settled();
    await send('unlit', readBackBuffer(device));
    await send('said', 'rendering in floats');
    const texture = intoFloat(view);
    await settled();
    await send('unlit_f32', readTexture(device, texture()));
    relighting.blend = blend;
    await settled();
    await send('frame_f32', readTexture(device, texture()));
}

try {
    await capture();
    await send('done', '');
} catch (error) {
    await send('failed', String(error?.stack ?? error));
}
