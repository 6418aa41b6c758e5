// The page: controls that change the mix, and the view that shows it.
import { blackBody, picker } from './colors.mjs';
import { loadFiles } from './files.mjs';
import { createHandles } from './handles.mjs';
import { createMix, exported, move, sliderOf, weightOf, weights } from './panel.mjs';
import { serve } from './served.mjs';

const FADE = matchMedia('(prefers-reduced-motion: reduce)').matches ? 0 : 600;  // milliseconds
const find = (id) => document.getElementById(id);
const make = (tag, properties = {}, ...children) => {
    const element = Object.assign(document.createElement(tag), properties);
    element.append(...children);
    return element;
};

function fader(state, refresh) {
    const { name } = state;
    const slider = make('input', { type: 'range', min: 0, max: 1, step: 0.001, ariaLabel: `${name}: strength` });
    const strength = make('output');
    const color = make('input', { type: 'color', ariaLabel: `${name}: colour`, title: 'Colour' });
    const kelvin = make('input', { type: 'range', min: 1700, max: 12000, step: 50, value: 6500, ariaLabel: `${name}: Kelvin`, title: 'Kelvin' });
    const temperature = make('output', { textContent: 'Kelvin' });
    const solo = make('button', { type: 'button', className: 'solo', textContent: 'Solo', ariaLabel: `${name}: solo` });
    const update = () => {
        slider.value = sliderOf(state.strength);
        strength.value = `× ${state.strength.toFixed(2)}`;
        color.value = state.hex;
    };
    const changed = (change) => { Object.assign(state, change, { exact: null }); update(); refresh(); };
    slider.addEventListener('input', () => changed({ strength: weightOf(Number(slider.value)) }));
    slider.addEventListener('dblclick', () => changed({ strength: 1 }));
    color.addEventListener('input', () => { temperature.value = 'Kelvin'; changed({ hex: color.value }); });
    kelvin.addEventListener('input', () => {
        temperature.value = `${kelvin.value} K`;
        changed({ hex: picker(blackBody(Number(kelvin.value))) });
    });
    update();
    const row = make('fieldset', {},
        make('legend', { textContent: name, title: name }), solo,
        make('div', { className: 'strength' }, slider, strength),
        make('div', { className: 'tools' }, color, kelvin, temperature));
    return { row, solo };
}

function start(view, description) {
    let mix = createMix(description);
    let shown = { weights: weights(mix, description), share: description.blend };
    let running = 0, served = null;
    const handles = createHandles(find('handles'), view, {
        pick: (handle) => pick(handle.layer),
        move: description.live && ((handle, position, ended) => {
            move(mix, handle, position);
            served.moved(handle, position);
            if (!ended) pick(handle.layer);
        })
    });

    const paint = () => view.show(shown.weights, shown.share, mix.exposure);
    const aim = () => ({ weights: weights(mix, description), share: mix.captured ? 0 : description.blend });
    const jump = () => { running++; shown = aim(); paint(); };
    const fade = () => {
        const [from, to, own, began] = [shown, aim(), ++running, performance.now()];
        const step = (now) => {
            if (own !== running) return;
            const t = FADE ? Math.min(Math.max(now - began, 0) / FADE, 1) : 1;
            const s = t * t * (3 - 2 * t);
            shown = t === 1 ? to : {
                weights: to.weights.map((rgb, i) => rgb.map((x, c) => from.weights[i][c] + s * (x - from.weights[i][c]))),
                share: from.share + s * (to.share - from.share)
            };
            paint();
            if (t < 1) requestAnimationFrame(step);
        };
        requestAnimationFrame(step);
    };

    const changed = () => served?.changed();
    const mark = () => {
        [...find('lightings').children].forEach((button, i) => button.setAttribute('aria-pressed', i === mix.chosen));
        find('captured').setAttribute('aria-pressed', mix.captured);
        find('exposure').value = mix.exposure;
        changed();
        find('exposure').nextElementSibling.value = `${mix.exposure > 0 ? '+' : ''}${mix.exposure.toFixed(2)} EV`;
    };
    const rows = () => {
        const lighting = mix.lightings[mix.chosen];
        const made = lighting.faders.map((state) => fader(state, () => { mix.captured = false; mark(); jump(); }));
        const solos = () => made.forEach(({ solo }, i) => solo.setAttribute('aria-pressed', lighting.solo === i));
        made.forEach(({ solo }, i) => solo.addEventListener('click', () => {
            lighting.solo = lighting.solo === i ? null : i;
            mix.captured = false;
            solos(); mark(); fade();
        }));
        solos();
        find('faders').replaceChildren(...made.map(({ row }) => row));
        handles.show(lighting.handles);
        pick(null);
    };
    const pick = (layer) => {
        const faders = mix.lightings[mix.chosen].faders;
        handles.select(layer);
        [...find('faders').children].forEach((row, i) => {
            const picked = faders[i].layer === layer;
            row.classList.toggle('picked', picked);
            if (picked) row.scrollIntoView({ block: 'nearest' });
        });
    };
    const choose = (index) => {
        if (index >= mix.lightings.length) return;
        Object.assign(mix, { chosen: index, captured: false });
        rows(); mark(); fit(); fade();
    };
    // the picture has the room that the panel leaves
    const fit = () => {
        const panel = find('panel').getBoundingClientRect();
        const below = panel.width >= innerWidth;
        const folded = find('panel').classList.contains('folded');
        view.resize(innerWidth - (below || folded ? 0 : panel.width), innerHeight - (below ? panel.height : 0));
    };
    const actions = {
        captured: () => { mix.captured = !mix.captured; mark(); fade(); },
        reset: () => {
            const before = mix.lightings.flatMap((lighting) => lighting.handles);
            mix = { ...createMix(description), chosen: mix.chosen };
            mix.lightings.flatMap((lighting) => lighting.handles).forEach((handle, i) => {
                if (served && before[i].position !== handle.first) served.moved(handle, handle.first);
            });
            rows(); mark(); fade();
        },
        export: () => {
            find('exported').querySelector('pre').textContent = exported(mix, description);
            find('exported').showModal();
        },
        fold: () => {
            const folded = find('panel').classList.toggle('folded');
            find('fold').textContent = folded ? 'Show' : 'Hide';
            find('fold').setAttribute('aria-expanded', !folded);
            fit();
        }
    };

    find('title').textContent = description.title;
    find('lightings').replaceChildren(...mix.lightings.map(({ name }, i) => {
        const button = make('button', { type: 'button', textContent: name, title: i < 9 ? String(i + 1) : '' });
        button.addEventListener('click', () => choose(i));
        return button;
    }));
    for (const [id, act] of Object.entries(actions)) find(id).addEventListener('click', act);
    find('exposure').addEventListener('input', () => { mix.exposure = Number(find('exposure').value); mark(); paint(); });
    find('camera').replaceChildren(...description.cameras.map(({ name }, i) => make('option', { value: i, textContent: name })));
    find('camera').addEventListener('change', () => view.go(description.cameras[find('camera').value]));
    find('camera-row').hidden = description.cameras.length < 2;
    find('copy').addEventListener('click', async () => {
        const text = find('exported').querySelector('pre');
        getSelection().selectAllChildren(text);
        try { await navigator.clipboard.writeText(text.textContent); } catch { document.execCommand('copy'); }
    });
    find('download').addEventListener('click', () => {
        const url = URL.createObjectURL(new Blob([exported(mix, description)], { type: 'text/plain' }));
        make('a', { href: url, download: 'mix.toml' }).click();
        URL.revokeObjectURL(url);
    });
    const keys = { c: 'captured', r: 'reset', e: 'export', h: 'fold', p: 'render' };
    addEventListener('keydown', (event) => {
        if (event.ctrlKey || event.metaKey || event.altKey || find('exported').open) return;
        if (event.target.matches?.('select, input[type=color]')) return;
        if (/^[1-9]$/.test(event.key)) choose(Number(event.key) - 1);
        else actions[keys[event.key.toLowerCase()]]?.();
    });
    if (description.live) {
        served = serve(view, {
            mix: () => mix, text: () => exported(mix, description), paint,
            moved: (place, position) => { move(mix, place, position); handles.place(); }
        });
        Object.assign(actions, { render: served.render, save: served.save });
        for (const id of ['render', 'save']) {
            find(id).hidden = false;
            find(id).addEventListener('click', actions[id]);
        }
    }
    rows();
    mark();
    find('panel').hidden = false;
    fit();
    addEventListener('resize', fit);
    view.go(description.cameras[0]);
    view.watch(() => { handles.place(); served?.seen(); });
    paint();
    return { mix: () => mix, choose, actions, jump, served };
}

export async function open() {
    const message = find('message');
    try {
        const { description, layers, behind } = await loadFiles();
        const [{ createView }, { createBehind }] = await Promise.all([import('./view.mjs'), import('./behind.mjs')]);
        const view = await createView(find('view'), description, layers,
            behind && ((device) => createBehind(device, description.behind, behind, description.tone)));
        const page = start(view, description);
        message.hidden = true;
        return { view, description, ...page };
    } catch (error) {
        message.hidden = false;
        message.textContent = error.message;
        throw error;
    }
}

globalThis.mixer = open();
