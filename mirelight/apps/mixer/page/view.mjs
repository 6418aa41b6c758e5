// The capture in the engine, with its layers of light: weights go in, a picture comes out.
import * as pc from 'playcanvas';
import { CameraControls } from './engine/camera-controls.mjs';

const CURVES = { none: pc.TONEMAP_NONE, aces: pc.TONEMAP_ACES, neutral: pc.TONEMAP_NEUTRAL, agx: pc.TONEMAP_NONE };
const COMPONENTS = ['x', 'y', 'z', 'w'];
const AFTERWARDS = 2000;  // milliseconds that are drawn once nothing changes any more: a worker may still sort splats

// Runs where splats are copied to the work buffer: display-encoded colour in and out, the light linear between.
function modifier(count, space) {
    const textures = Math.ceil(count / 4);
    const terms = Array.from({ length: count }, (_, i) =>
        `    light += uMix[${i}] * unpacked(layers${i >> 2}.${COMPONENTS[i & 3]});`);
    const reads = Array.from({ length: textures }, (_, k) => `    uvec4 layers${k} = loadMix${k}();`);
    return `
uniform vec3 uMix[${count}];
uniform vec3 uShown;  // share of the mix, largest factor, exposure
uniform vec4 uSplit;  // a plane: the splats before it are lit, those behind it are as captured
vec3 unpacked(uint v) {
    return vec3(uvec3(v, v >> 9u, v >> 18u) & 511u) * exp2(float(v >> 27u) - 24.0);
}
vec3 decoded(vec3 c) {
    return mix(c / 12.92, pow((max(c, 0.0) + 0.055) / 1.055, vec3(2.4)), vec3(greaterThan(c, vec3(0.04045))));
}
vec3 encoded(vec3 c) {
    return mix(c * 12.92, 1.055 * pow(max(c, 0.0), vec3(1.0 / 2.4)) - 0.055, vec3(greaterThan(c, vec3(0.0031308))));
}
void modifySplatCenter(inout vec3 center) {}
void modifySplatRotationScale(vec3 originalCenter, vec3 modifiedCenter, inout vec4 rotation, inout vec3 scale) {}
void modifySplatColor(vec3 center, inout vec4 color) {
    vec3 light = vec3(0.0);
${reads.join('\n')}
${terms.join('\n')}
    light = mix(vec3(1.0), min(light, vec3(uShown.y)), dot(uSplit, vec4(center, 1.0)) < 0.0 ? 0.0 : uShown.x);
    vec3 shown = max(color.xyz, 0.0);
${space === 'display' ? '    shown = decoded(shown * light);' : '    shown = decoded(shown) * light;'}
    color.xyz = encoded(shown * uShown.z);
}`;
}

function load(app, url) {
    return new Promise((resolve, reject) => {
        // unsorted, so that splats keep the order of their layers
        const asset = new pc.Asset('splats', 'gsplat', { url, filename: url }, { reorder: false });
        asset.once('load', () => resolve(asset));
        asset.once('error', (error) => reject(new Error(`${url}: ${error}`)));
        app.assets.add(asset);
        app.assets.load(asset);
    });
}

async function createApp(canvas) {
    let device;
    try {
        device = await pc.createGraphicsDevice(canvas, { deviceTypes: ['webgl2'], antialias: false, preserveDrawingBuffer: true });
    } catch {
        device = null;
    }
    if (!device?.isWebGL2) throw new Error('This browser shows no WebGL 2: use a newer one, or switch its graphics acceleration on');
    device.maxPixelRatio = 1;
    const options = new pc.AppOptions();
    options.graphicsDevice = device;
    options.componentSystems = [pc.CameraComponentSystem, pc.ScriptComponentSystem, pc.GSplatComponentSystem];
    options.resourceHandlers = [pc.TextureHandler, pc.ScriptHandler, pc.GSplatHandler];
    const app = new pc.AppBase(canvas);
    app.init(options);
    return app;
}

// Gives what replaces a layer.
function upload(app, component, resource, count, layers, layerCount) {
    const textures = Math.ceil(layerCount / 4);
    const names = Array.from({ length: textures }, (_, k) => `mix${k}`);
    resource.format.addExtraStreams(names.map((name) => ({ name, format: pc.PIXELFORMAT_RGBA32U })));
    resource.streams?.syncWithFormat?.(resource.format);
    const put = (texels, c, packed, start) => { for (let i = 0; i < count; i++) texels[4 * i + c] = packed[start + i]; };
    if (layers) names.forEach((name, k) => {
        const texels = resource.getTexture(name).lock();
        for (let c = 0; c < 4 && 4 * k + c < layerCount; c++) put(texels, c, layers, (4 * k + c) * count);
        resource.getTexture(name).unlock();
    });
    return (layer, packed) => {
        const texture = resource.getTexture(names[layer >> 2]);
        put(texture.lock(), layer & 3, packed, 0);
        texture.unlock();
    };
}

// layers: Uint32Array of the layers' packed values, one after another; null: none yet
// backed: makes what draws light behind the splats, of a device; none: the description's colour is there
export async function createView(canvas, description, layers, backed) {
    const app = await createApp(canvas);
    app.setCanvasFillMode(pc.FILLMODE_NONE);
    app.setCanvasResolution(pc.RESOLUTION_AUTO);
    app.scene.gsplat.dataFormat = pc.GSPLATDATA_LARGE;  // colours above 4 are kept until they are blended
    app.start();

    const camera = new pc.Entity('camera');
    camera.addComponent('camera', {
        clearColor: backed ? new pc.Color(0, 0, 0, 0) : new pc.Color(...description.background, 1), toneMapping: CURVES[description.tone],
        layers: [pc.LAYERID_WORLD, pc.LAYERID_UI, pc.LAYERID_IMMEDIATE]
    });
    camera.addComponent('script');
    app.root.addChild(camera);
    const controls = camera.script.create(CameraControls);

    const asset = await load(app, description.splats.file);
    const count = description.layers.length;
    const entity = new pc.Entity('splats');
    entity.addComponent('gsplat', { asset, unified: true });
    const replaced = upload(app, entity.gsplat, asset.resource, description.count, layers, count);
    entity.gsplat.setWorkBufferModifier({ glsl: modifier(count, description.space) });
    entity.gsplat.setParameter('uSplit', [0, 0, 0, 1]);
    app.root.addChild(entity);

    let bookmark = null, width = 1, height = 1;
    const fit = () => {
        if (!bookmark) return;
        // where there is less room than the frame is wide, the view opens until the whole frame is seen
        const narrower = Math.max(1, bookmark.aspect / (width / height));
        camera.camera.fov = 2 * Math.atan(Math.tan(bookmark.fov * Math.PI / 360) * narrower) * 180 / Math.PI;
    };

    // Draws while something changes, and a little longer: a page at rest leaves the machine to what traces.
    const watching = [];
    let until = 0, before = '', moved = false;
    const wake = () => { until = performance.now() + AFTERWARDS; };
    app.autoRender = false;
    app.graphicsDevice.on('devicerestored', wake);
    app.systems.gsplat.on('frame:ready', (_camera, _layer, ready, loading) => { if (!ready || loading > 0) wake(); });
    app.on('framerender', () => {
        const now = [...camera.getWorldTransform().data, camera.camera.fov, width, height].join();
        if (now !== before) { before = now; moved = true; wake(); }
        app.renderNextFrame = performance.now() < until;
    });
    app.on('frameend', () => {
        if (!moved) return;
        moved = false;
        for (const seen of watching) seen();
    });

    const column = (k) => Array.from(camera.getWorldTransform().data.slice(4 * k, 4 * k + 3));
    const eye = () => ({
        position: column(3), right: column(0), up: column(1), forward: column(2).map((x) => -x),
        world: [0, 1, 0], fov: camera.camera.fov * Math.PI / 180, width, height, near: camera.camera.nearClip
    });

    const behind = backed?.(app.graphicsDevice);
    if (behind) app.scene.on('postrender', (seenBy) => { if (seenBy === camera.camera) behind.draw(eye()); });

    return {
        app, camera, eye,
        wake,  // to be called where something is changed past this view
        // packed: Uint32Array of RGB9E5 over scale, one of each splat; seen from the next `show` on
        replace(layer, packed, scale) {
            replaced(layer, packed);
            description.layers[layer].scale = scale;
        },
        // [x, y] in pixels of the canvas; null: not in the picture
        project(point) {
            const { position, right, up, forward, fov, near } = eye();
            const d = point.map((x, k) => x - position[k]);
            const [x, y, z] = [right, up, forward].map((axis) => d[0] * axis[0] + d[1] * axis[1] + d[2] * axis[2]);
            const size = height / (2 * Math.tan(fov / 2) * z);
            const at = [width / 2 + x * size, height / 2 - y * size];
            return z > near && at[0] >= 0 && at[0] <= width && at[1] >= 0 && at[1] <= height ? at : null;
        },
        get size() { return [width, height]; },
        // calls when the camera or the picture's size has changed
        watch(seen) {
            watching.push(seen);
            moved = true;
        },
        limit(most) { description.limit = most; },  // of the sum of layers; null: none
        // plane: [x, y, z, w] in the world; see the shader's uSplit
        split(plane) {
            entity.gsplat.setParameter('uSplit', plane);
            wake();
        },
        // weights: an array of [r, g, b] for each layer; share: 0 as captured, 1 the mix; exposure in stops
        show(weights, share, exposure) {
            const values = new Float32Array(3 * count);
            weights.forEach((rgb, i) => rgb.forEach((x, c) => { values[3 * i + c] = x * description.layers[i].scale; }));
            entity.gsplat.setParameter('uMix[0]', values);
            entity.gsplat.setParameter('uShown', [share, description.limit ?? 1e30, 2 ** exposure]);
            behind?.show(weights, description.blend > 0 ? share / description.blend : 1, exposure);
            wake();
        },
        resize(...size) {
            [width, height] = size.map((x) => Math.max(Math.floor(x), 1));
            app.resizeCanvas(width, height);
            fit();
            wake();
        },
        go(to) {
            bookmark = to;
            camera.camera.nearClip = to.near;
            camera.camera.farClip = to.far;
            camera.setPosition(...to.position);
            camera.lookAt(new pc.Vec3(to.target), new pc.Vec3(to.up));
            controls.reset(new pc.Vec3(to.target), new pc.Vec3(to.position));
            fit();
        }
    };
}
