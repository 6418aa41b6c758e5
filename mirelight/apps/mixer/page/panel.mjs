// What is mixed: for each lighting its faders, which of them is soloed, and what goes to the job file.
import { linear, split } from './colors.mjs';

export const weightOf = (s) => 8 * s ** 3;  // of a slider from 0 to 1: the middle is 1, the left end exactly 0
export const sliderOf = (w) => Math.min(Math.cbrt(w / 8), 1);

export function createMix(description) {
    const lightings = description.lightings.map(({ name, faders, handles }) => ({
        name, solo: null, faders: faders.map((fader) => ({ ...fader, ...split(fader.factor), exact: fader.factor })),
        handles: handles.map((handle) => ({ ...handle, first: handle.position }))
    }));
    return { lightings, chosen: 0, captured: false, exposure: description.exposure };
}

// `exact` is a factor that nobody has changed here, which the picker's 8 bits would round.
export const factorOf = (fader) => fader.exact ?? linear(fader.hex).map((x) => x * fader.strength);

const heard = (lighting, index) => lighting.solo === null || lighting.solo === index;

// Factors by the names of layers, as the job's `mix` has them.
export const factors = (lighting) => Object.fromEntries(lighting.faders.map((fader, index) =>
    [fader.name, heard(lighting, index) ? factorOf(fader) : [0, 0, 0]]));

// A lamp that several lightings share is one lamp: it moves in all of them.
export function move(mix, { layer, light }, position) {
    for (const { handles } of mix.lightings) {
        for (const handle of handles) if (handle.layer === layer && handle.light === light) handle.position = position;
    }
}

export function weights(mix, description) {
    const out = description.layers.map(() => [0, 0, 0]);
    for (const layer of description.constant) out[layer] = [1, 1, 1];
    const lighting = mix.lightings[mix.chosen];
    lighting.faders.forEach((fader, index) => {
        if (!heard(lighting, index)) return;
        const factor = factorOf(fader);
        out[fader.layer] = out[fader.layer].map((x, c) => x + fader.weight[c] * factor[c]);
    });
    return out;
}

// --- the job file ---

const number = (x) => String(Number(x.toPrecision(6)));
const key = (name) => (/^[\w-]+$/.test(name) ? name : JSON.stringify(name).replaceAll('\x7f', '\\u007F'));

function value(factor) {
    return factor.every((x) => x === factor[0]) ? number(factor[0]) : `[${factor.map(number).join(', ')}]`;
}

const elsewhere = ({ first, position }) => position.some((x, k) => number(x) !== number(first[k]));

// The tables [mix], [moved] and [display] as TOML. Factors that are 1 and lights where the job has them are left out.
export function exported(mix, description) {
    const several = description.several;  // in the job, whatever the page shows of it
    const lines = [];
    for (const lighting of mix.lightings) {
        const changed = lighting.faders.flatMap((fader, index) => {
            const factor = heard(lighting, index) ? factorOf(fader) : [0, 0, 0];
            return factor.every((x) => x === 1) ? [] : [`${key(fader.name)} = ${value(factor)}`];
        });
        if (changed.length) lines.push(several ? `[mix.${key(lighting.name)}]` : '[mix]', ...changed, '');
    }
    for (const lighting of mix.lightings) {
        const moved = lighting.handles.filter(elsewhere)
            .map(({ name, position }) => `${key(name)} = [${position.map(number).join(', ')}]`);
        if (moved.length) lines.push(several ? `[moved.${key(lighting.name)}]` : '[moved]', ...moved, '');
    }
    return [...lines, '[display]', `exposure = ${number(mix.exposure)}`, ''].join('\n');
}
