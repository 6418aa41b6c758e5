// The job that is edited: its values, what was done to it and can be undone, and what its lights weigh.
import { blackBody, linear, picker } from './colors.mjs';
import { LIGHTS } from './lights.mjs';

const TOGETHER = 700;  // milliseconds within which changes of one thing are undone together
const DEGREES = 180 / Math.PI;

const copy = (value) => JSON.parse(JSON.stringify(value));

// changed: called after each change
export function createModel(job, changed) {
    let now = copy(job), past = [], future = [], last = { what: '', time: -1e9 };
    const after = () => { last = { what: '', time: -1e9 }; changed(); };
    return {
        get job() { return now; },
        // what: names the thing, so that a slider's many changes are one; edit: changes the job that it is given
        change(what, edit) {
            const time = performance.now();
            if (what !== last.what || time - last.time > TOGETHER) {
                past = [...past.slice(-199), copy(now)];
                future = [];
            }
            last = { what, time };
            edit(now);
            changed();
        },
        undo() {
            if (!past.length) return;
            future.push(now);
            now = past.pop();
            after();
        },
        redo() {
            if (!future.length) return;
            past.push(now);
            now = future.pop();
            after();
        },
        get canUndo() { return past.length > 0; },
        get canRedo() { return future.length > 0; }
    };
}

// --- what a light weighs ---

// A light's linear colour times its intensity, up to a factor that stays while only these change.
export function strength(light) {
    const color = light.kelvin ? blackBodyOfLuminance(light.kelvin) : light.color ?? [1, 1, 1];
    return color.map((x) => x * (light.intensity ?? 1));
}

function blackBodyOfLuminance(kelvin) {
    const rgb = blackBody(kelvin);
    const luminance = 0.2126 * rgb[0] + 0.7152 * rgb[1] + 0.0722 * rgb[2];
    return rgb.map((x) => x / luminance);
}

// [r, g, b] by which a layer's weight, told of one state of a lighting, is multiplied to be that of another.
export function ratio(before, now, name) {
    const find = (lighting) => lighting?.lights?.find((x) => x.name === name)
        ?? (['environment', 'sun', 'sky'].includes(name) ? around(lighting) : null);
    const [a, b] = [find(before), find(now)];
    if (!a) return [1, 1, 1];
    if (!b) return [0, 0, 0];
    const [from, to] = [strength(a), strength(b)];
    return from.map((x, c) => (x > 0 ? to[c] / x : 1));
}

const around = (lighting) => (lighting?.environment ? { intensity: table(lighting.environment).intensity ?? 1 } : null);

export const table = (value) => (typeof value === 'string' ? { path: value } : value ?? null);

// Whether a lighting is the light that the capture was made under, which is found and not edited.
export const isCaptured = (lighting) => lighting.name === 'captured' && !lighting.lights?.length && !lighting.lights_from && !lighting.environment;

export const shownColor = (light) => picker(normal(light.kelvin ? blackBody(light.kelvin) : light.color ?? [1, 1, 1]));

const normal = (rgb) => { const top = Math.max(...rgb, 1e-9); return rgb.map((x) => x / top); };

export const rounded = (x, digits = 6) => Number(x.toPrecision(digits));

// a coordinate to a hundred-thousandth of what things are away
export function placed(x, away) {
    const digits = Math.min(Math.max(5 - Math.floor(Math.log10(Math.max(away, 1e-9))), 0), 15);
    return Number(x.toFixed(digits));
}

export const fromPicker = (hex) => linear(hex).map((x) => rounded(x, 5));

// --- where things are ---

export const plus = (a, b, s = 1) => a.map((x, k) => x + s * b[k]);
export const length = (a) => Math.hypot(...a);

// [elevation, azimuth] in degrees of a far light, as the job counts them: north is -Z, east +X.
export function placeInSky(light) {
    if (!light.direction) return [light.elevation ?? 45, light.azimuth ?? 180];
    const [x, y, z] = light.direction.map((v) => -v / length(light.direction));
    return [Math.asin(y) * DEGREES, (Math.atan2(x, -z) * DEGREES + 360) % 360].map((v) => rounded(v, 5));
}

// A direction to a far light, [elevation, azimuth] in degrees, and back.
export const toSky = (way) => placeInSky({ direction: way.map((x) => -x) });
export function fromSky([elevation, azimuth]) {
    const [e, a] = [elevation / DEGREES, azimuth / DEGREES];
    return [Math.cos(e) * Math.sin(a), Math.sin(e), -Math.cos(e) * Math.cos(a)];
}

// How far light from all around is turned, counter-clockwise seen from above, in degrees; null: it cannot be.
export function turned(environment) {
    const around = table(environment);
    if (around?.path) return around.rotation ?? 0;
    return around?.sky && 'elevation' in around.sky ? -(around.sky.azimuth ?? 180) : null;
}
export function turn(environment, degrees) {
    const around = table(environment), wrapped = (x) => rounded(((x + 180) % 360 + 360) % 360 - 180, 4);
    if (around.path) return { ...around, rotation: wrapped((around.rotation ?? 0) + degrees) };
    return { ...around, sky: { ...around.sky, azimuth: rounded((((around.sky.azimuth ?? 180) - degrees) % 360 + 360) % 360, 4) } };
}

// Where a lamp shines at, so that it can be dragged.
export function aimOf(light, reach) {
    if (light.target) return light.target;
    return light.direction ? plus(light.position, light.direction, reach / length(light.direction)) : null;
}

export function freeName(wanted, taken) {
    let name = wanted;
    for (let n = 2; taken.includes(name); n++) name = `${wanted}-${n}`;
    return name;
}

// A light of a type before the camera, about as bright as the capture under light of a level (cd/m²).
export function newLight(type, { eye, away, level, taken, beside }) {
    const name = freeName({ point: 'lamp', area: 'panel' }[type] ?? type, taken);
    const n = (x) => rounded(x, 4), place = (a) => a.map((x) => placed(x, away));
    const ahead = plus(eye.position, eye.forward, away);
    const aside = 0.2 * away * [0, -1, 1, -2, 2][beside % 5];  // none on top of another
    const above = plus(plus(plus(eye.position, eye.forward, 0.75 * away), eye.world, 0.22 * away), eye.right, aside);
    const reach = length(plus(above, ahead, -1));
    const candela = n(Math.PI * level * reach ** 2);
    if (type === 'sun') {
        const azimuth = (Math.atan2(-eye.right[0], eye.right[2]) * DEGREES + 390) % 360;
        return { type, name, elevation: 40, azimuth: Math.round(azimuth), kelvin: 5200, intensity: n(3.2 * level), angular_diameter: 1 };
    }
    if (type === 'point') return { type, name, position: place(above), kelvin: 3000, intensity: candela, radius: n(0.02 * away) };
    const aimed = { type, name, position: place(above), target: place(ahead), kelvin: 4000 };
    if (type === 'spot') return { ...aimed, intensity: n(2 * candela), outer_cone_angle: 30, inner_cone_angle: 20, radius: n(0.02 * away) };
    const known = LIGHTS[type];
    if (known.fields.length) {  // as large as others; one that shines all around lies across the view
        const own = Object.fromEntries(known.fields.map((x) => [x.name, n(0.25 * away * x.default)]));
        const { target, ...still } = aimed;
        const way = known.oneSided ? { target } : { direction: Array.from(eye.right, n) };
        return { ...still, ...way, ...own, intensity: n(2 * candela), unit: 'candela' };
    }
    const size = n(0.25 * away);
    return { ...aimed, shape: 'rectangle', size, intensity: n(2 * candela / size ** 2) };
}

// --- films ---

// Cameras between cameras: Catmull-Rom splines through positions and targets, as many as asked for.
export function between(cameras, count) {
    const at = (values, t) => {
        const k = Math.min(Math.floor(t), values.length - 2), u = t - k;
        const [a, b, c, d] = [k - 1, k, k + 1, k + 2].map((i) => values[Math.min(Math.max(i, 0), values.length - 1)]);
        return b.map((_, i) => 0.5 * (2 * b[i] + (c[i] - a[i]) * u + (2 * a[i] - 5 * b[i] + 4 * c[i] - d[i]) * u * u
            + (3 * b[i] - a[i] - 3 * c[i] + d[i]) * u * u * u));
    };
    return Array.from({ length: count }, (_, i) => {
        const t = (cameras.length - 1) * i / Math.max(count - 1, 1);
        const one = (key) => at(cameras.map((x) => x[key]), t).map((x) => rounded(x));
        const [yfov] = at(cameras.map((x) => [x.yfov ?? 45]), t);
        return {
            name: `path-${String(i + 1).padStart(4, '0')}`, position: one('position'), target: one('target'),
            yfov: rounded(yfov, 5), near: Math.min(...cameras.map((x) => x.near ?? 0.01))
        };
    });
}
