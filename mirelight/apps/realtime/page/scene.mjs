// Builds the scene that scene.json describes: splats, proxy, lights, environment, camera, and PlayCanvas' own
// relighting script. Keys and units are those of mirelight's docs/guides/realtime.md.
import * as pc from 'playcanvas';
import { GSplatRelighting } from './engine/gsplat-relighting.mjs';

const TONE_CURVES = {
    none: pc.TONEMAP_NONE, linear: pc.TONEMAP_LINEAR, aces: pc.TONEMAP_ACES, aces2: pc.TONEMAP_ACES2,
    filmic: pc.TONEMAP_FILMIC, hejl: pc.TONEMAP_HEJL, neutral: pc.TONEMAP_NEUTRAL
};

// A light component's defaults where scene.json says nothing; constants of the engine may be named as strings.
const LIGHT_NAMES = [
    'color', 'intensity', 'luminance', 'range', 'innerConeAngle', 'outerConeAngle', 'falloffMode', 'castShadows', 'shadowType',
    'shadowResolution', 'shadowDistance', 'shadowBias', 'normalOffsetBias', 'penumbraSize', 'penumbraFalloff',
    'shadowSamples', 'shadowBlockerSamples'
];

const GLASS_CLEAR = 0.9;  // share of clear glass's pixels that show what is behind it
const constant = (value) => (typeof value === 'string' && value in pc ? pc[value] : value);
const vector = (value) => new pc.Vec3(value ?? [0, 0, 0]);

// scene.json has one file of splats or a list of them
export const splatFiles = ({ splat }) => (splat ? [splat].flat() : []);

export async function build(canvas, description) {
    const { width, height } = description;
    const app = await createApp(canvas, width, height);
    app.scene.clusteredLightingEnabled = description.clusteredLighting ?? true;
    app.start();

    const camera = addCamera(app, description);
    const relighting = addRelighting(camera, description.relighting);
    await Promise.all([
        addSplats(app, splatFiles(description)),
        description.proxy && addProxy(app, description.proxy, relighting),
        description.objects && addObjects(app, description.objects),
        description.env && addEnvironment(app, description.env)
    ]);
    const lit = [relighting.layer.id, ...(description.objects ? [pc.LAYERID_WORLD] : [])];
    const lights = (description.lights ?? []).map((light) => addLight(app, light, lit));
    const ambient = description.ambient ?? [0, 0, 0];
    app.scene.ambientLight = new pc.Color(ambient);
    app.scene.exposure = description.exposure ?? 1;
    if (description.physicalUnits) usePhysicalUnits(app.scene, camera, description);
    for (const [name, value] of Object.entries(description.gsplat ?? {})) {
        app.scene.gsplat[name] = constant(value);
    }
    const frame = description.pipeline === 'linear' ? addCameraFrame(app, camera, description) : null;
    return { app, camera, relighting, lights, frame };
}

// Lights count by their luminance; exposure and surroundings get the same values by the names they then have.
function usePhysicalUnits(scene, camera, description) {
    scene.physicalUnits = true;
    scene.ambientLuminance = 1;
    scene.skyboxLuminance = description.env?.intensity ?? 1;
    const aperture = Math.sqrt(1 / (1.2 * (description.exposure ?? 1)));  // exposure 1 / (1.2 aperture²) at 1 s, ISO 100
    Object.assign(camera.camera, { aperture, shutter: 1, sensitivity: 100 });
}

async function createApp(canvas, width, height) {
    const device = await pc.createGraphicsDevice(canvas, {
        deviceTypes: ['webgl2'], antialias: false, alpha: true, preserveDrawingBuffer: true
    });
    device.maxPixelRatio = 1;
    const options = new pc.AppOptions();
    options.graphicsDevice = device;
    options.componentSystems = [
        pc.RenderComponentSystem, pc.CameraComponentSystem, pc.LightComponentSystem,
        pc.ScriptComponentSystem, pc.GSplatComponentSystem
    ];
    options.resourceHandlers = [pc.TextureHandler, pc.ContainerHandler, pc.ScriptHandler, pc.GSplatHandler];
    const app = new pc.AppBase(canvas);
    app.init(options);
    app.setCanvasFillMode(pc.FILLMODE_NONE, width, height);
    app.setCanvasResolution(pc.RESOLUTION_FIXED, width, height);
    return app;
}

function addCamera(app, description) {
    const { position, target, up, fov, near, far } = description.camera;
    const gamma = description.pipeline !== 'linear';
    const entity = new pc.Entity('camera');
    entity.addComponent('camera', {
        fov, nearClip: near, farClip: far,
        clearColor: new pc.Color(description.clearColor ?? [0, 0, 0, 0]),
        toneMapping: gamma ? TONE_CURVES[description.toneMapping ?? 'none'] : pc.TONEMAP_NONE,
        // the environment lights the proxy alone: without the skybox layer it is not drawn behind the splats
        layers: [pc.LAYERID_WORLD, pc.LAYERID_DEPTH, pc.LAYERID_UI, pc.LAYERID_IMMEDIATE]
    });
    entity.setPosition(vector(position));
    entity.lookAt(vector(target), new pc.Vec3(up ?? [0, 1, 0]));
    entity.addComponent('script');
    app.root.addChild(entity);
    return entity;
}

function addRelighting(camera, attributes) {
    const script = camera.script.create(GSplatRelighting);
    Object.assign(script, attributes ?? {});
    return script;
}

function load(app, name, type, url, data) {
    return new Promise((resolve, reject) => {
        const asset = new pc.Asset(name, type, { url, filename: url.split('/').pop() }, data);
        asset.once('load', () => resolve(asset));
        asset.once('error', (error) => reject(new Error(`${url}: ${error}`)));
        app.assets.add(asset);
        app.assets.load(asset);
    });
}

function place(entity, transform) {
    entity.setLocalPosition(vector(transform.position));
    if (transform.rotation) entity.setLocalRotation(new pc.Quat(...transform.rotation));
    else entity.setLocalEulerAngles(vector(transform.eulerAngles));
    const scale = transform.scale ?? 1;
    entity.setLocalScale(...(Array.isArray(scale) ? scale : [scale, scale, scale]));
}

// All at once and in their order: splats at one depth are drawn in the order in which their files came into the scene.
async function addSplats(app, splats) {
    const assets = await Promise.all(splats.map(({ file }) => load(app, 'splats', 'gsplat', file)));
    splats.forEach((splat, i) => {
        const entity = new pc.Entity('splats');
        entity.addComponent('gsplat', { asset: assets[i], unified: true });
        place(entity, splat);
        app.root.addChild(entity);
    });
}

async function addProxy(app, proxy, relighting) {
    const asset = await load(app, 'proxy', 'container', proxy.file);
    const castShadows = !proxy.twoSidedShadows;
    const entity = asset.resource.instantiateRenderEntity({ castShadows, receiveShadows: true });
    for (const component of entity.findComponents('render')) {
        component.layers = [relighting.layer.id];
        if (!castShadows) relighting.layer.addShadowCasters(component.meshInstances.map(twoSided));
        for (const instance of component.meshInstances) {
            instance.material = proxyMaterial(proxy, instance.material);
            relighting.configureMaterial(instance.material);
        }
    }
    place(entity, proxy);
    app.root.addChild(entity);
}

// Things in the capture, with their files' materials: drawn before the splats, which they hide and which veil them, and
// lit by the same lights, so that they and the proxy cast on each other.
async function addObjects(app, objects) {
    const asset = await load(app, 'objects', 'container', objects.file);
    const entity = asset.resource.instantiateRenderEntity({ castShadows: false, receiveShadows: true });
    const world = app.scene.layers.getLayerById(pc.LAYERID_WORLD);
    ditherEvenly(app.graphicsDevice);
    for (const component of entity.findComponents('render')) {
        for (const { material } of component.meshInstances) ditherClear(material);
        world.addShadowCasters(component.meshInstances.map(twoSided));
    }
    place(entity, objects);
    app.root.addChild(entity);
}

// What is half there hides so many pixels in a pattern: were it blended, it would lie before or behind all splats. Glass
// without a map of it does so, too; what it mirrors needs some pixels left.
function ditherClear(material) {
    if (material.blendType !== pc.BLEND_NORMAL) return;
    if (!material.refractionMap) material.opacity *= 1 - GLASS_CLEAR * material.refraction;
    material.refraction = 0;
    material.useDynamicRefraction = false;
    material.blendType = pc.BLEND_NONE;
    material.depthWrite = true;
    material.opacityDither = pc.DITHER_BAYER8;
    material.update();
}

// The engine's pattern has alpha^(1 / 2.2) of the pixels; this one alpha of them.
function ditherEvenly(device) {
    const chunks = pc.ShaderChunks.get(device, pc.SHADERLANGUAGE_GLSL);
    chunks.set('opacityDitherPS', chunks.get('opacityDitherPS').replace('noise = pow(noise, 2.2);', ''));
}

// The engine culls back faces in shadow maps too, so that a wall which turns its back to a light casts no shadow. This
// copy is drawn into shadow maps alone, from both sides.
function twoSided(instance) {
    const material = new pc.StandardMaterial();
    const { opacity, opacityMap, opacityMapChannel, alphaTest, opacityDither } = instance.material;
    material.cull = pc.CULLFACE_NONE;
    Object.assign(material, { opacity, opacityMap, opacityMapChannel, alphaTest, opacityShadowDither: opacityDither });
    material.update();
    const caster = new pc.MeshInstance(instance.mesh, material, instance.node);
    caster.castShadow = true;
    return caster;
}

// A matt material: gray (or `diffuse`, display-encoded), or the file's own colours where `ownColors` is set.
function proxyMaterial(proxy, own) {
    const material = new pc.StandardMaterial();
    if (proxy.ownColors) {
        material.diffuse = own.diffuse;
        material.diffuseMap = own.diffuseMap;
        material.diffuseVertexColor = own.diffuseVertexColor;
    } else {
        const diffuse = proxy.diffuse ?? 0.5;
        material.diffuse = new pc.Color(Array.isArray(diffuse) ? diffuse : [diffuse, diffuse, diffuse]);
    }
    return material;
}

function addLight(app, light, layers) {
    const entity = new pc.Entity(light.name ?? light.type);
    const options = { type: light.type, layers, castShadows: false };
    for (const name of LIGHT_NAMES) {
        if (light[name] !== undefined) options[name] = constant(light[name]);
    }
    options.color = new pc.Color(light.color ?? [1, 1, 1]);
    entity.addComponent('light', options);
    app.root.addChild(entity);
    entity.setPosition(vector(light.position));
    if (light.eulerAngles) entity.setEulerAngles(vector(light.eulerAngles));
    const way = light.direction ? vector(light.direction) : light.target && vector(light.target).sub(entity.getPosition());
    if (way) entity.setRotation(new pc.Quat().setFromDirections(pc.Vec3.DOWN, way.normalize()));  // it shines along -Y
    return entity;
}

async function addEnvironment(app, env) {
    const asset = await load(app, 'environment', 'texture', env.equirect, { mipmaps: false });
    asset.resource.projection = pc.TEXTUREPROJECTION_EQUIRECT;
    const source = pc.EnvLighting.generateLightingSource(asset.resource);
    app.scene.envAtlas = pc.EnvLighting.generateAtlas(source);
    source.destroy();
    app.scene.skyboxIntensity = env.intensity ?? 1;
    app.scene.skyboxRotation = new pc.Quat().setFromEulerAngles(0, env.rotation ?? 0, 0);
}

function addCameraFrame(app, camera, description) {
    const frame = new pc.CameraFrame(app, camera.camera);
    frame.rendering.toneMapping = TONE_CURVES[description.toneMapping ?? 'none'];
    if (description.hdrFormat) frame.rendering.renderFormats = [pc[`PIXELFORMAT_${description.hdrFormat}`]];
    frame.update();
    return frame;
}
