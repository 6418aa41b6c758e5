// Rows of the panel: a light, what comes from all around.
import { fromPicker, placeInSky, rounded, shownColor, table } from './model.mjs';
import { blackBody, picker } from './colors.mjs';
import { LIGHTS } from './lights.mjs';

const STOPS = 8;  // that an intensity's slider goes up and down

export const make = (tag, properties = {}, ...children) => {
    const element = Object.assign(document.createElement(tag), properties);
    element.append(...children.filter((x) => x !== null && x !== undefined));
    return element;
};

// a number with its unit behind it
const measured = (unit, input) => make('span', { className: 'measured' }, input, make('span', { textContent: unit }));

const row = (label, ...inputs) => make('label', { className: inputs.length > 1 ? 'row two' : 'row' }, make('span', { textContent: label }), ...inputs);

// A number that is typed; given: what it is at first, and null where the field may be left empty.
function number(label, value, { min = null, max = null, step = 'any', placeholder = '' }, changed) {
    const input = make('input', { type: 'number', step, placeholder, ariaLabel: label, value: value ?? '' });
    if (min !== null) input.min = min;
    if (max !== null) input.max = max;
    input.addEventListener('change', () => {
        if (input.value === '') return changed(null);
        const found = Number(input.value);
        if (Number.isFinite(found)) changed(Math.min(Math.max(found, min ?? -Infinity), max ?? Infinity));
    });
    return input;
}

function slider(label, value, { min, max, step }, changed) {
    const input = make('input', { type: 'range', min, max, step, value, ariaLabel: label });
    input.addEventListener('input', () => changed(Number(input.value)));
    return input;
}

// A number by slider and by hand, both in step.
function both(name, label, value, limits, changed) {
    const typed = number(`${name}: ${label}`, value, limits, (x) => { slid.value = x ?? limits.min; changed(x ?? limits.min); });
    const slid = slider(`${name}: ${label}, slider`, value, limits, (x) => { typed.value = x; changed(x); });
    return row(label, slid, typed);
}

function intensity(name, light, unit, changed) {
    const first = light.intensity ?? 1, middle = first || 1;
    const stops = (x) => (x > 0 ? Math.log2(x / middle) : -STOPS);
    const typed = number(`${name}: intensity in ${unit}`, rounded(first, 4), { min: 0 }, (x) => {
        slid.value = stops(x ?? 0);
        changed(x ?? 0);
    });
    const slid = slider(`${name}: intensity, slider`, stops(first), { min: -STOPS, max: STOPS, step: 0.05 }, (s) => {
        const x = s <= -STOPS ? 0 : rounded(middle * 2 ** s, 4);
        typed.value = x;
        changed(x);
    });
    return row(unit, slid, typed);
}

function colour(name, light, set) {
    const chosen = make('input', { type: 'color', value: shownColor(light), ariaLabel: `${name}: colour` });
    const kelvin = number(`${name}: Kelvin`, light.kelvin, { min: 1000, max: 25000, step: 50, placeholder: 'Kelvin' }, (k) => {
        if (k) chosen.value = picker(blackBody(k));
        set((x) => { delete x.color; delete x.kelvin; if (k) x.kelvin = k; });
    });
    chosen.addEventListener('input', () => {
        kelvin.value = '';
        set((x) => { delete x.kelvin; x.color = fromPicker(chosen.value); });
    });
    return row('Colour', chosen, measured('K', kelvin));
}

// [elevation, azimuth] by place and time. ask(request) -> [elevation, azimuth]
function byTime(name, ask, set) {
    const limits = (most) => ({ min: -most, max: most });
    const latitude = number(`${name}: latitude`, null, { ...limits(90), placeholder: 'north °' }, () => {});
    const longitude = number(`${name}: longitude`, null, { ...limits(180), placeholder: 'east °' }, () => {});
    const time = make('input', { type: 'datetime-local', ariaLabel: `${name}: time` });
    const offset = number(`${name}: hours from UTC`, 0, { min: -14, max: 14, step: 0.25 }, () => {});
    const go = make('button', { type: 'button', textContent: 'Set' });
    go.addEventListener('click', async () => {
        const minutes = Math.round(60 * Number(offset.value || 0)), whole = Math.abs(minutes);
        const pad = (x) => String(x).padStart(2, '0');
        const zone = `${minutes < 0 ? '-' : '+'}${pad(Math.floor(whole / 60))}:${pad(whole % 60)}`;
        const found = await ask({
            latitude: latitude.value === '' ? null : Number(latitude.value),
            longitude: longitude.value === '' ? null : Number(longitude.value), time: `${time.value}${zone}`
        });
        if (found) set(...found.map((x) => rounded(x, 5)));
    });
    return make('details', {}, make('summary', { textContent: 'By place and time' }),
        make('div', { className: 'grid' }, latitude, longitude, time, make('label', {}, 'UTC ', offset), go));
}

function sky(name, light, set, ask) {
    const [elevation, azimuth] = placeInSky(light);
    const put = (change) => set((x) => {
        const [e, a] = placeInSky(x);
        delete x.direction;
        Object.assign(x, { elevation: e, azimuth: a }, change);
    });
    return [
        both(name, 'Elevation °', elevation, { min: -90, max: 90, step: 0.5 }, (x) => put({ elevation: x })),
        both(name, 'Azimuth °', azimuth, { min: 0, max: 360, step: 1 }, (x) => put({ azimuth: x })),
        byTime(name, ask, (e, a) => { put({ elevation: e, azimuth: a }); set(() => {}, true); })
    ];
}

// on: { set(edit, again), remove(), ask(request) }; `again`: the rows are to be made anew
export function lightRow(light, on) {
    const { name } = light, parts = [];
    const set = on.set;
    const size = (label, key, least) => row(label,
        number(`${name}: ${label}`, Array.isArray(light[key]) ? light[key][0] : light[key] ?? 0, { min: least }, (x) => set((l) => { l[key] = Math.max(x ?? least, least); })));
    if (light.type !== 'playcanvas') parts.push(colour(name, light, set));
    parts.push(intensity(name, light, light.unit ?? LIGHTS[light.type]?.unit ?? 'intensity', (x) => set((l) => { l.intensity = x; })));
    if (light.type === 'point' || light.type === 'spot') parts.push(size('Radius', 'radius', 0));
    if (light.type === 'area') parts.push(size('Size', 'size', 1e-4));
    for (const { label, name: key, least } of LIGHTS[light.type]?.fields ?? []) parts.push(size(label, key, least));
    if (light.type === 'spot' && !light.spot) {
        parts.push(both(name, 'Cone °', light.outer_cone_angle ?? 45, { min: 1, max: 90, step: 1 }, (x) => set((l) => {
            l.outer_cone_angle = x;
            l.inner_cone_angle = Math.min(l.inner_cone_angle ?? 0, rounded(0.95 * x));
        })));
    }
    if (light.type === 'sun') parts.push(both(name, 'Disc °', light.angular_diameter ?? 0.53, { min: 0.1, max: 20, step: 0.1 }, (x) => set((l) => { l.angular_diameter = x; })));
    if (light.type === 'sun' || light.type === 'directional') parts.push(...sky(name, light, set, on.ask));
    return framed('light', name, on, parts);
}

function framed(kind, name, on, parts) {
    const remove = make('button', { type: 'button', className: 'small', textContent: 'Remove', ariaLabel: `Remove ${name}` });
    remove.addEventListener('click', on.remove);
    const title = make('input', { type: 'text', value: name, maxLength: 60, ariaLabel: `Name of ${name}`, className: 'name' });
    title.addEventListener('change', () => on.rename(title.value.trim()));
    return make('fieldset', { id: `${kind}-${name}` }, make('legend', {}, title), remove, ...parts);
}

// on: { set(edit, again), remove(), rename(name), canMove, turned, turn(degrees) }
export function thingRow(thing, on) {
    const { name } = thing, parts = [];
    if (on.canMove) {
        const scale = () => thing.transform?.scale ?? 1;
        parts.push(
            both(name, 'Turn °', on.turned, { min: -180, max: 180, step: 1 }, on.turn),
            row('Scale', number(`${name}: Scale`, scale(), { min: 1e-4 }, (x) => on.set((t) => { t.transform = { ...t.transform, scale: x || 1 }; })))
        );
    }
    const stands = make('select', { ariaLabel: `${name}: how it stands` });
    const ways = { false: 'where it is', true: 'upright on the ground', tilt: 'along the ground' };
    for (const [value, text] of Object.entries(ways)) stands.append(make('option', { value, textContent: text, selected: value === String(thing.drop ?? false) }));
    stands.addEventListener('change', () => on.set((t) => {
        delete t.scatter;
        t.drop = { false: false, true: true, tilt: 'tilt' }[stands.value];
    }));
    parts.push(row('Stands', stands));
    const share = (label, key) => row(label, number(`${name}: ${label}`, thing[key], { min: 0, max: 1, step: 0.05, placeholder: 'as its file has it' },
        (x) => on.set((t) => { if (x === null) delete t[key]; else t[key] = x; })));
    parts.push(share('Roughness', 'roughness'), share('Metallic', 'metallic'));
    return framed('thing', name, on, parts);
}

const KINDS = { none: 'nothing', radiance: 'even light', path: 'panorama', sky: 'clear sky' };
const kindOf = (around) => (around ? ['path', 'sky', 'radiance'].find((x) => x in around) : 'none');

// on: { set(environment, again), ask(request), choose() }
export function aroundRow(value, level, on) {
    const around = table(value), kind = kindOf(around), parts = [];
    const select = make('select', { ariaLabel: 'Light from all around' },
        ...Object.entries(KINDS).map(([key, text]) => make('option', { value: key, textContent: text, selected: key === kind })));
    select.addEventListener('change', () => {
        if (select.value === 'path') {
            select.value = kind;
            on.choose();
            return;
        }
        const begun = { none: null, radiance: { radiance: [0.8, 1, 1.3], intensity: rounded(0.3 * level, 3) }, sky: { sky: { elevation: 40, azimuth: 150 }, intensity: rounded(1e-4 * level, 3) } };
        on.set(() => begun[select.value], true);
    });
    const set = (change) => on.set((now) => ({ ...table(now), ...change }));
    if (around) parts.push(intensity('All around', around, 'times', (x) => set({ intensity: x })));
    if (kind === 'radiance') {
        const rgb = Array.isArray(around.radiance) ? around.radiance : [around.radiance, around.radiance, around.radiance];
        const chosen = make('input', { type: 'color', value: shownColor({ color: rgb }), ariaLabel: 'All around: colour' });
        const top = Math.max(...rgb) || 1;
        chosen.addEventListener('change', () => set({ radiance: fromPicker(chosen.value).map((x) => rounded(x * top, 5)) }));
        parts.push(row('Colour', chosen));
    }
    if (kind === 'path') {
        const other = make('button', { type: 'button', textContent: around.path.split('/').pop(), ariaLabel: `Panorama ${around.path}: choose another` });
        other.addEventListener('click', () => on.choose());
        parts.push(row('Picture', other), both('All around', 'Turn °', around.rotation ?? 0, { min: -180, max: 180, step: 1 }, (x) => set({ rotation: x })));
    }
    if (kind === 'sky') {
        const put = (change) => on.set((now) => { const t = table(now); return { ...t, sky: { ...t.sky, ...change } }; });
        const turn = (change) => on.set((now) => {
            const { latitude, longitude, time, ...rest } = table(now).sky;
            return { ...table(now), sky: { elevation: 30, ...rest, ...change } };
        }, 'elevation' in change && 'azimuth' in change);
        parts.push(both('Sky', 'Elevation °', around.sky.elevation ?? 30, { min: 0.5, max: 90, step: 0.5 }, (x) => turn({ elevation: x })),
            both('Sky', 'Azimuth °', around.sky.azimuth ?? 180, { min: 0, max: 360, step: 1 }, (x) => turn({ azimuth: x })),
            both('Sky', 'Haze', around.sky.turbidity ?? 3, { min: 1, max: 10, step: 0.5 }, (x) => put({ turbidity: x })),
            byTime('Sky', on.ask, (e, a) => turn({ elevation: Math.max(e, 0.5), azimuth: a })));
    }
    return make('fieldset', {}, make('legend', {}, 'All around'), row('From', select), ...parts);
}
