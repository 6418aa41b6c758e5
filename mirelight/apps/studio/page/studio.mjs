// The page: the capture in the engine, the panel that edits its job, and what the server makes of it.
import { createBall } from './ball.mjs';
import { createHandles } from './handles.mjs';
import { LIGHTS } from './lights.mjs';
import { createNewest, send } from './live.mjs';
import { createMesh } from './mesh.mjs';
import { aimOf, between, createModel, freeName, fromSky, isCaptured, length, newLight, placed, placeInSky, plus, ratio, rounded, table, toSky, turn, turned } from './model.mjs';
import { createQueue } from './queue.mjs';
import { aroundRow, lightRow, make } from './rows.mjs';
import { createObjects } from './things.mjs';
import { createUpright } from './upright.mjs';
import { createView } from './view.mjs';

const SLOTS = 32;  // layers that the view has room for; the last is the misfit of the proxy
const FINEST = 256;  // samples of a splat
const AGAIN = 'start mirelight studio again';
const find = (id) => document.getElementById(id);

function start(view, studio) {
    const first = studio.job, queue = createQueue(find('queue'), { open: openFrame, cancel: (number) => put('live/cancel', { number }) });
    let chosen = 0, state = null, cameras = studio.cameras, lightings = studio.lightings, bookmark = cameras[0] ?? null;
    let asCaptured = false, comparing = false, misfit = false, still = null, number = 0, adopted = false, level = 1;
    const sent = new Map([[0, first]]);  // jobs by number, by which weights are told
    const model = createModel({ ...first, cameras: first.cameras ?? [], lightings: first.lightings ?? [] }, changed);
    const newest = createNewest(say, AGAIN);
    const slots = { of: '', names: new Map(), versions: [] };
    const ball = createBall(find('ball'), (degrees) => {
        if (turned(lighting().environment) === null) return;
        model.change('around', (job) => { job.lightings[chosen].environment = turn(lighting().environment, degrees); });
        const [label, now] = table(lighting().environment).path ? ['All around: Turn °', turned(lighting().environment)] : ['Sky: Azimuth °', -turned(lighting().environment)];
        tellField(label, now);
    });
    const objects = createObjects(model, {
        view, put, again: () => again(), away: () => away(), rows: () => rows(), handles: () => later('handles', showHandles), tell: tellField,
        sent: (edit) => sent.get(edit), number: () => number
    });
    const foundBall = createBall(find('found-ball'));
    let overlay = null;  // shows and hides the mesh

    // a number that was changed in the picture, in its row
    function tellField(label, value) {
        for (const end of ['', ', slider']) for (const input of document.querySelectorAll(`[aria-label=${CSS.escape(label + end)}]`)) input.value = value;
    }
    function balls() {
        const now = turned(lighting().environment), then = state && turned(sent.get(state.around[1])?.lightings.find((x) => x.name === state.shown)?.environment);
        ball.draw(view.eye(), now === null || then === null || then === undefined ? 0 : now - then);
        find('ball').setAttribute('aria-valuenow', now ?? 0);
        foundBall.draw(view.eye());
    }

    // --- the server ---

    function say(text) {
        find('error').textContent = text;
        find('error').hidden = !text;
    }
    async function put(name, body) {
        try {
            const answer = JSON.parse(await send(name, body, AGAIN));
            say('');
            return answer;
        } catch (error) {
            say(error.message);
            return null;
        }
    }
    const lighting = () => model.job.lightings[chosen];
    async function tell() {
        number += 1;
        sent.set(number, JSON.parse(JSON.stringify(model.job)));
        sent.delete(number - 100);
        say('');
        const answer = await newest('live/job', 'job', { number, shown: lighting().name, job: model.job });
        if (!answer) return;
        const before = JSON.stringify(cameras);
        ({ cameras, lightings } = JSON.parse(answer));
        if (JSON.stringify(cameras) !== before) later('cameras', cameraRows);
    }
    async function follow() {
        for (let after = 0; ;) {
            try {
                const answer = await fetch(`live/state?after=${after}`);
                if (answer.status === 404) return location.reload();  // another one is open
                if (!answer.ok) throw new Error(String(answer.status));
                state = await answer.json();
                after = state.version;
                await heard();
            } catch {
                say(`the server does not answer: ${AGAIN}`);
                await new Promise((resolve) => setTimeout(resolve, 2000));
            }
        }
    }
    async function heard() {
        if (state.trouble) say(state.trouble);
        if (state.level) level = state.level;
        find('edited').hidden = !state.edited;
        find('misfit').disabled = find('mesh').disabled = find('near').hidden = state.near === null;
        find('near').textContent = `${Math.floor(100 * state.near)} % of the splats lie on the proxy mesh.`;
        const lines = [state.line && `${state.line}…`, state.tracing && `${state.tracing}: ${Math.floor(100 * state.done)} %`];
        find('news').textContent = lines.filter(Boolean).join(' · ') || (finest() ? 'The light is as fine as it gets here' : '');
        find('queue-section').hidden = !state.renders.length;
        queue.show(state.renders);
        if (state.estimate && !adopted) found(state.estimate);
        await objects.heard(state.objects);
        await layers();
        if (state.shown === lighting().name) await ball.load(state.around[0] && (table(lighting().environment) || isCaptured(lighting())) ? `live/around/${state.around[0]}` : '');
        balls();
        paint();
        if (still) showFrame();
    }
    const finest = () => state.shown === lighting().name && state.layers.length > 0 && state.layers.every((x) => x.samples >= FINEST || !x.name);
    // what of the shown lighting is newer than what the view has
    async function layers() {
        if (state.shown !== lighting().name) return;
        if (slots.of !== state.shown) Object.assign(slots, { of: state.shown, names: new Map(), versions: [] });
        const keys = state.layers.map((x, i) => x.name || `:${i}`);
        for (const key of [...slots.names.keys()]) if (!keys.includes(key)) slots.names.delete(key);
        for (const [i, { version, scale }] of state.layers.entries()) {
            if (!slots.names.has(keys[i])) {
                const free = Array.from({ length: SLOTS - 1 }, (_, k) => k).find((k) => ![...slots.names.values()].includes(k));
                slots.names.set(keys[i], free);
                slots.versions[free] = 0;
            }
            const slot = slots.names.get(keys[i]);
            if (!version || slots.versions[slot] === version) continue;
            const answer = await fetch(`live/layer/${version}`);
            if (!answer.ok) continue;  // there is a newer one by now
            view.replace(slot, new Uint32Array(await answer.arrayBuffer()), scale);
            slots.versions[slot] = version;
        }
    }
    function paint() {
        const weights = Array.from({ length: SLOTS }, () => [0, 0, 0]);
        const lit = state && slots.of === lighting().name && state.layers.length > 0;
        if (lit) {
            const before = sent.get(state.number)?.lightings.find((x) => x.name === state.shown);
            for (const [i, { name, weight }] of state.layers.entries()) {
                const slot = slots.names.get(name || `:${i}`);
                if (slot === undefined || !slots.versions[slot]) continue;
                const by = name && before ? ratio(before, lighting(), name) : [1, 1, 1];
                weights[slot] = weight.map((x, c) => x * by[c]);
            }
        }
        objects.show(!asCaptured && !misfit);
        if (misfit) weights.forEach((_, k) => { weights[k] = k === SLOTS - 1 ? [1, 1, 1] : [0, 0, 0]; });
        view.limit(misfit ? null : state?.limit ?? null);
        view.show(weights, misfit || (lit && !asCaptured) ? 1 : 0, model.job.display?.exposure ?? 0);
        find('compare').disabled = !lit;
    }

    // --- edits ---

    let signature = '';  // of the rows, which stay while it does
    const signed = () => JSON.stringify([chosen, lighting().name, objects.signature, (lighting().lights ?? []).map((x) => [x.name, x.type])]);
    // rows and handles are not taken away from under a pointer that is about to click on them or drags them
    let pressed = false;
    const pending = new Map();
    const later = (what, act) => { if (pressed) pending.set(what, act); else act(); };
    const release = () => setTimeout(() => {
        pressed = false;
        for (const [what, act] of pending) { pending.delete(what); act(); }
    });
    addEventListener('pointerdown', () => { pressed = true; }, true);
    for (const kind of ['pointerup', 'pointercancel']) addEventListener(kind, release, true);
    function changed() {
        if (chosen >= model.job.lightings.length) chosen = model.job.lightings.length - 1;
        closeFrame();
        if (signed() !== signature) later('rows', rows);
        follows();
        handles.place();
        tabs();
        marks();
        balls();
        paint();
        tell();
    }
    const again = () => { signature = ''; };
    const setLight = (index, edit, anew = false) => {
        if (anew) again();
        model.change(`light ${index}`, (job) => edit(job.lightings[chosen].lights[index]));
    };
    const ask = (request) => put('live/sun', request);
    const taken = () => ['environment', 'sky', 'emission', ...(table(lighting().environment)?.sky ? ['sun'] : []), ...(lightings[chosen]?.lights ?? []), ...(lighting().lights ?? []).map((x) => x.name)];
    const away = () => (bookmark ? length(plus(bookmark.target, bookmark.position, -1)) : 3);
    function rename(index, name) {
        if (!name || taken().includes(name)) return rows();
        model.change('name', (job) => { job.lightings[chosen].lights[index].name = name; });
    }
    function remove(index) {
        model.change('remove', (job) => {
            const one = job.lightings[chosen];
            one.lights.splice(index, 1);
            if (!one.lights.length) delete one.lights;
            if (!one.lights && !one.lights_from && !one.environment) one.environment = { radiance: [1, 1, 1], intensity: 0 };
        });
    }
    function add(type) {
        const beside = (lighting().lights ?? []).filter((x) => x.position).length;
        const light = newLight(type, { eye: view.eye(), away: away(), level, taken: taken(), beside });
        model.change(`add ${light.name}`, (job) => { (job.lightings[chosen].lights ??= []).push(light); });
        pick(light.name);
        find(`light-${light.name}`)?.querySelector('input[type=number]')?.focus();
    }
    function pick(name) {
        const lights = lighting().lights ?? [];
        handles.select(lights.findIndex((x) => x.name === name));
        for (const row of [...find('lights').children, ...find('things').children]) {
            const picked = row.id === `light-${name}` || row.id === `thing-${name}`;
            row.classList.toggle('picked', picked);
            if (picked) row.scrollIntoView({ block: 'nearest' });
        }
    }
    const handles = createHandles(find('handles'), view, {
        pick: (handle) => (handle.upright ? upright.pick() : pick(handle.light ?? handle.thing)),
        move(handle, position, ended) {
            held = ended ? null : handle;
            if (handle.sun) return shine(handle, position, ended);
            if (handle.thing) return objects.move(handle, position, ended);
            if (handle.upright) { upright.move(handle, position, ended); return upright.place(); }
            handle.position = position;
            model.change(`move ${handle.name}`, (job) => {
                const light = job.lightings[chosen].lights.find((x) => x.name === handle.light);
                const place = position.map((x) => placed(x, away()));
                if (handle.aims) { delete light.direction; light.target = place; } else light.position = place;
            });
            if (!ended) pick(handle.light);
        }
    });

    const upright = createUpright({ line: find('arrow'), focus: () => focus(), away: () => away(), view, turn: (way) => turnUp({ way }) });

    // a sun's handle moves about what is looked at: which way it lies from there is where the sun stands
    const focus = () => bookmark?.target ?? [0, 0, 0];
    const sunPlace = (light) => plus(focus(), fromSky(placeInSky(light)), 0.6 * away());
    function shine(handle, position, ended) {
        const [elevation, azimuth] = toSky(plus(position, focus(), -1)).map((x) => Number(x.toFixed(1)));
        handle.position = sunPlace({ elevation, azimuth });
        model.change(`move ${handle.name}`, (job) => {
            const light = job.lightings[chosen].lights.find((x) => x.name === handle.light);
            delete light.direction;
            Object.assign(light, { elevation, azimuth });
        });
        tellField(`${handle.light}: Elevation °`, elevation);
        tellField(`${handle.light}: Azimuth °`, azimuth);
        if (!ended) pick(handle.light);
    }

    // --- what is shown ---

    function tabs() {
        const names = model.job.lightings.map((x) => x.name), list = find('lightings');
        while (list.children.length > names.length) list.lastChild.remove();
        while (list.children.length < names.length) {
            const index = list.children.length;
            list.append(action('', '', () => choose(index)));
        }
        names.forEach((name, i) => {
            Object.assign(list.children[i], { textContent: name, title: i < 9 ? String(i + 1) : '', ariaLabel: name });
            list.children[i].setAttribute('aria-pressed', i === chosen);
        });
        if (document.activeElement !== find('lighting-name')) find('lighting-name').value = lighting().name;
        find('lighting-name').disabled = isCaptured(lighting());
        for (const button of find('add').children) button.disabled = isCaptured(lighting());
        find('less').disabled = names.length < 2;
    }
    function rows() {
        signature = signed();
        const lights = lighting().lights ?? [];
        find('lights').replaceChildren(...lights.map((light, i) => lightRow(light, {
            set: (edit, anew) => setLight(i, edit, anew), remove: () => remove(i), rename: (name) => rename(i, name), ask
        })));
        const theirs = (lightings[chosen]?.lights ?? []).filter((x) => !lights.some((y) => y.name === x));
        if (lighting().lights_from && theirs.length) find('lights').append(make('p', { textContent: `From a file: ${theirs.join(', ')}` }));
        if (isCaptured(lighting())) {
            find('lights').append(make('p', { textContent: 'The light that the capture was made under: it is found, and has no lights to edit.' }));
            find('around').replaceChildren();
        } else aroundRows();
        find('things').replaceChildren(...objects.rows());
        showHandles();
    }
    let drawn = [], held = null;  // handles, and the one that is dragged
    function showHandles() {
        const lights = lighting().lights ?? [];
        const light = (name) => (lighting().lights ?? []).find((x) => x.name === name);
        drawn = [...upright.handles(), ...objects.handles(), ...lights.flatMap(({ name, type, position }, layer) => {
            const one = { name, light: name, layer };
            if (type === 'sun' || type === 'directional') return [{ ...one, sun: true, now: () => light(name) && sunPlace(light(name)) }];
            if (!position) return [];
            const aim = () => light(name) && aimOf(light(name), 0.4 * away());
            return [{ ...one, now: () => light(name)?.position }, ...(aim() ? [{ ...one, name: `${name}: aim`, aims: true, now: aim }] : [])];
        })];
        follows();
        handles.show(drawn);
        for (const [i, button] of [...find('handles').children].entries()) {
            button.classList.toggle('aim', Boolean(drawn[i].aims || drawn[i].turns));
            button.classList.toggle('thing', Boolean(drawn[i].thing));
            button.classList.toggle('sun', Boolean(drawn[i].sun));
            button.classList.toggle('upright', Boolean(drawn[i].upright));
        }
        upright.place();
    }
    // handles stand where rows and undo have put their lights
    function follows() {
        for (const handle of drawn) if (handle !== held) handle.position = handle.now?.() ?? handle.position;
    }
    const aroundRows = () => find('around').replaceChildren(aroundRow(lighting().environment, level, {
        set: (edit, anew) => {
            if (anew) again();
            model.change('around', (job) => {
                const one = job.lightings[chosen], made = edit(one.environment);
                if (made?.sky) for (const x of one.lights ?? []) if (x.name === 'sun' || x.name === 'sky') x.name = freeName(`${x.name}-2`, taken());
                if (made) one.environment = made;
                else if (one.lights?.length || one.lights_from) delete one.environment;
                else one.environment = { radiance: [1, 1, 1], intensity: 0 };
            });
        },
        ask, choose: () => file.click()
    }));
    const action = (text, label, act) => {
        const button = make('button', { type: 'button', textContent: text, title: label, ariaLabel: label });
        button.addEventListener('click', act);
        return button;
    };
    function marks() {
        const exposure = model.job.display?.exposure ?? 0;
        find('exposure').value = exposure;
        find('exposure').nextElementSibling.value = `${exposure > 0 ? '+' : ''}${exposure.toFixed(2)} EV`;
        [find('width').value, find('height').value] = model.job.resolution ?? [1280, 720];
        find('samples').value = model.job.render?.spp ?? 64;
        find('captured').setAttribute('aria-pressed', asCaptured);
        find('compare').setAttribute('aria-pressed', comparing);
        find('misfit').setAttribute('aria-pressed', misfit);
        find('mesh').setAttribute('aria-pressed', Boolean(overlay));
        find('undo').disabled = !model.canUndo;
        find('redo').disabled = !model.canRedo;
        find('saved').textContent = '';
        const as = JSON.stringify(model.job.captured) === JSON.stringify(first.captured);
        find('captured-assumed').setAttribute('aria-pressed', as);
        find('captured-found').setAttribute('aria-pressed', !as);
    }
    function cameraRows() {
        const own = model.job.cameras.map((x) => x.name);
        find('cameras').replaceChildren(...cameras.map((camera) => {
            const name = make('button', { type: 'button', className: 'wide', textContent: camera.name, title: 'Go there' });
            name.addEventListener('click', () => go(camera));
            const render = make('button', { type: 'button', className: 'small', textContent: 'Render', ariaLabel: `Render ${camera.name}` });
            render.addEventListener('click', () => put('live/render', { camera: camera.name, lighting: lighting().name }));
            const gone = make('button', { type: 'button', className: 'small', textContent: 'Remove', ariaLabel: `Remove ${camera.name}` });
            gone.addEventListener('click', () => model.change(`remove ${camera.name}`, (job) => { job.cameras = job.cameras.filter((x) => x.name !== camera.name); }));
            gone.disabled = !own.includes(camera.name) || own.length < 2;
            return make('div', { className: 'camera' }, name, render, gone);
        }));
    }
    function choose(index) {
        if (index >= model.job.lightings.length || index === chosen) return;
        chosen = index;
        asCaptured = false;
        again();
        changed();
    }
    function duplicate() {
        const name = freeName('lighting', model.job.lightings.map((x) => x.name));
        const like = JSON.parse(JSON.stringify(lighting()));
        chosen = model.job.lightings.length;
        asCaptured = false;
        if (isCaptured(like)) like.environment = { radiance: [1, 1, 1], intensity: rounded(level, 3) };  // even, as bright
        model.change('another lighting', (job) => { job.lightings.push({ ...like, name }); });
        find('lighting-name').focus();
        find('lighting-name').select();
    }
    function removeLighting() {
        if (model.job.lightings.length < 2) return;
        const index = chosen;
        chosen = Math.max(index - 1, 0);
        model.change('one lighting less', (job) => { job.lightings.splice(index, 1); });
    }
    function go(camera) {
        bookmark = camera;
        view.go(camera);
        rows();
    }

    // --- the captured light ---

    function found(estimate) {
        adopted = true;
        find('captured-lines').replaceChildren(...estimate.lines.map((x) => make('li', { textContent: x })));
        find('captured-lines').parentElement.hidden = false;
        find('panorama').src = `data:image/png;base64,${estimate.picture}`;
        find('panorama').hidden = false;
        foundBall.load(find('panorama').src).then(balls);
        find('captured-said').textContent = estimate.sound ? 'Found from the capture:' : 'The capture does not tell its light well; an even one is assumed.';
        if (!estimate.sound) return;
        find('captured-choice').hidden = false;
        // new light keeps its ratio to the captured one, so that the picture keeps its brightness
        const take = (edits, by) => model.change('captured light', (job) => {
            Object.assign(job, edits);
            for (const key of ['captured', 'proxy']) if (job[key] === undefined) delete job[key];
            for (const one of job.lightings) {
                for (const light of one.lights ?? []) light.intensity = rounded((light.intensity ?? 1) * by);
                if (one.environment) {
                    if (typeof one.environment === 'string') one.environment = { path: one.environment };
                    one.environment.intensity = rounded((one.environment.intensity ?? 1) * by);
                }
            }
        });
        const isFound = () => model.job.captured === estimate.edits.captured;
        find('captured-found').onclick = () => { again(); if (!isFound()) take(estimate.edits, estimate.level); };
        find('captured-assumed').onclick = () => { again(); if (isFound()) take({ captured: first.captured, proxy: first.proxy }, 1 / estimate.level); };
        if (studio.begun && !isFound()) find('captured-found').click();
    }

    // --- frames ---

    const pose = () => {
        const eye = view.eye(), n = (a) => a.map((x) => placed(x, away()));
        return {
            position: n(eye.position), target: n(plus(eye.position, eye.forward, away())),
            yfov: rounded(eye.fov * 180 / Math.PI, 5), near: rounded(eye.near, 4)
        };
    };
    async function renderStill() {
        if (still) return closeFrame();
        const [width, height] = view.size;
        const made = await put('live/render', { view: { name: 'view', ...pose(), width: 2 * Math.round(width / 2), height: 2 * Math.round(height / 2) }, lighting: lighting().name });
        if (made) still = { number: made, eye: JSON.stringify(view.eye()) };
    }
    function showFrame() {
        const entry = queue.entry(still.number);
        if (!entry?.url || still.url === entry.url) return;
        still.url = entry.url;
        openFrame(entry.render, entry.url);
    }
    function openFrame(render, url) {
        const [width, height] = view.size;
        still ??= { number: render.number, url, eye: null };
        find('still').querySelector('img').src = url;
        Object.assign(find('still').style, { width: `${width}px`, height: `${height}px` });
        find('still').hidden = false;
        find('split').hidden = false;
        seen();
    }
    function closeFrame() {
        if (!still) return;
        still = null;
        find('still').hidden = true;
        find('split').hidden = !comparing;
        seen();
    }
    // before | after: a plane through the eye, left of which splats are as captured
    function seen() {
        handles.place();
        upright.place();
        balls();
        if (still?.eye && still.eye !== JSON.stringify(view.eye())) closeFrame();
        const share = Number(find('split').value), eye = view.eye();
        find('still').style.setProperty('--split', share);
        if (!comparing || still) return view.split([0, 0, 0, 1]);
        const x = (2 * share - 1) * Math.tan(eye.fov / 2) * eye.width / eye.height;
        const normal = plus(eye.right, eye.forward, -x);
        view.split([...normal, -normal.reduce((sum, v, k) => sum + v * eye.position[k], 0)]);
    }

    // --- controls ---

    const actions = {
        captured: () => { asCaptured = !asCaptured; closeFrame(); marks(); paint(); },
        compare: () => {
            if (find('compare').disabled) return;
            comparing = !comparing;
            asCaptured = false;
            closeFrame();
            find('split').hidden = !comparing;
            marks(); paint(); seen();
        },
        misfit: async () => {
            const answer = misfit ? null : await fetch('live/misfit');
            misfit = Boolean(answer?.ok);
            if (misfit) {
                const data = await answer.arrayBuffer();
                view.replace(SLOTS - 1, new Uint32Array(data, 4), new DataView(data).getFloat32(0, true));
            }
            closeFrame(); marks(); paint();
        },
        mesh: async () => {
            const answer = overlay ? null : await fetch('live/mesh');
            overlay?.(false);
            overlay = answer?.ok ? createMesh(view.app, await answer.arrayBuffer()) : null;
            overlay?.(true);
            view.wake();
            marks();
        },
        upright: () => {
            if (!studio.begun) return;
            upright.toggle();
            find('upright').setAttribute('aria-pressed', upright.on);
            showHandles();
        },
        'render-still': renderStill,
        undo: () => { again(); model.undo(); cameraRows(); },
        redo: () => { again(); model.redo(); cameraRows(); },
        close: closeFrame,
        more: duplicate,
        read: async () => { if (await put('live/read', '') !== null || find('error').hidden) location.reload(); },
        less: removeLighting,
        save: async () => {
            const name = await put('live/save', '');
            if (name) find('saved').textContent = `Saved: ${name}`;
        },
        'keep-view': () => {
            const names = [...cameras, ...model.job.cameras].map((x) => x.name);
            let count = 1;
            while (names.includes(`view-${count}`)) count++;
            const name = `view-${count}`;
            // the view opens where it is narrower than frames are, as it does when it goes to the camera
            const [width, height] = model.job.resolution ?? [1280, 720], eye = view.eye();
            const narrower = Math.max(1, width / height / (eye.width / eye.height));
            const yfov = rounded(2 * Math.atan(Math.tan(eye.fov / 2) / narrower) * 180 / Math.PI, 5);
            model.change(`camera ${name}`, (job) => { job.cameras.push({ name, ...pose(), yfov }); });
        },
        path: () => {
            const keys = model.job.cameras.filter((x) => x.position && x.target && !/^path-\d{4}$/.test(x.name));
            if (keys.length < 2) return say('a path needs two saved views: go somewhere and save the view');
            const asked = Number(prompt(`Frames from ${keys[0].name} to ${keys.at(-1).name}`, '48'));
            if (!(asked >= 2 && asked <= 2000)) return;
            model.change('path', (job) => {
                job.cameras = [...job.cameras.filter((x) => !/^path-\d{4}$/.test(x.name)), ...between(keys, Math.round(asked))];
            });
        },
        'render-all': async () => {
            for (const { name } of cameras) {
                for (const one of model.job.lightings) if (!await put('live/render', { camera: name, lighting: one.name })) return;
            }
        },
        fold: () => {
            const folded = find('panel').classList.toggle('folded');
            find('fold').textContent = folded ? 'Show' : 'Hide';
            find('fold').setAttribute('aria-expanded', !folded);
            fit();
        }
    };
    for (const [id, act] of Object.entries(actions)) find(id).addEventListener('click', act);
    for (const [type, { fields }] of Object.entries(LIGHTS)) {
        if (!fields.length) continue;
        const button = make('button', { id: `add-${type}`, type: 'button', textContent: `+ ${type[0].toUpperCase()}${type.slice(1)}` });
        button.addEventListener('click', () => add(type));
        find('add-sun').before(button);
    }
    for (const type of ['point', 'spot', 'area', 'sun']) find(`add-${type}`).addEventListener('click', () => add(type));
    find('exposure').addEventListener('input', () => {
        model.change('exposure', (job) => { (job.display ??= {}).exposure = Number(find('exposure').value); });
    });
    find('lighting-name').addEventListener('change', () => {
        const name = find('lighting-name').value.trim();
        if (!name || model.job.lightings.some((x) => x.name === name)) return tabs();
        model.change('lighting name', (job) => { job.lightings[chosen].name = name; });
    });
    for (const [i, id] of ['width', 'height'].entries()) {
        find(id).addEventListener('change', () => model.change(id, (job) => {
            job.resolution = (job.resolution ?? [1280, 720]).map((x, k) => (k === i ? Math.round(Number(find(id).value)) || x : x));
        }));
    }
    find('samples').addEventListener('change', () => model.change('samples', (job) => {
        (job.render ??= {}).spp = Math.max(Math.round(Number(find('samples').value)) || 64, 1);
    }));
    find('split').addEventListener('input', seen);
    find('up-row').hidden = !studio.begun;
    if (![...find('up').options].some((x) => x.value === studio.up)) find('up').append(make('option', { value: studio.up, textContent: 'by hand' }));
    find('up').value = studio.up;
    let turning = false;  // a drag ends in a click, too
    async function turnUp(asked) {
        if (turning) return;
        turning = true;
        const sure = !model.canUndo || confirm('Begin again with another way up? Lights and cameras are set anew.');
        if (sure && (await put('live/turn', asked) !== null || find('error').hidden)) return location.reload();
        find('up').value = studio.up;
        if (upright.on) actions.upright();
        turning = false;
    }
    find('up').addEventListener('change', () => turnUp({ up: find('up').value }));
    const keys = { c: 'captured', b: 'compare', m: 'misfit', n: 'mesh', p: 'render-still', s: 'save', h: 'fold', u: 'upright' };
    addEventListener('keydown', (event) => {
        const typing = event.target.matches?.('select, textarea, input:not([type=range]):not([type=color])');
        if (typing) return;
        if ((event.ctrlKey || event.metaKey) && /^[zy]$/i.test(event.key)) {
            event.preventDefault();
            actions[event.key.toLowerCase() === 'y' || event.shiftKey ? 'redo' : 'undo']();
        } else if (!event.ctrlKey && !event.metaKey && !event.altKey) {
            if (/^[1-9]$/.test(event.key)) choose(Number(event.key) - 1);
            else if (event.key === 'Escape') closeFrame();
            else actions[keys[event.key.toLowerCase()]]?.();
        }
    });
    const picker = (accept, take) => {
        const input = make('input', { type: 'file', accept });
        input.addEventListener('change', () => { if (input.files[0]) take(input.files[0]); input.value = ''; });
        return input;
    };
    const panorama = async (chosenFile) => {
        if (isCaptured(lighting())) return say('The captured light is found, and not edited: show another lighting');
        const name = await put(`live/upload/${encodeURIComponent(chosenFile.name)}`, chosenFile);
        if (!name) return;
        again();
        model.change('around', (job) => { job.lightings[chosen].environment = { path: name.path, intensity: rounded(name.intensity * level, 4) }; });
    };
    const another = async (capture) => {
        if (model.canUndo && !confirm(`Open ${capture.name} in place of this one? What was not saved is lost.`)) return;
        if (await put(`live/open/${encodeURIComponent(capture.name)}`, capture) !== null || find('error').hidden) location.reload();
    };
    const kinds = [
        { suffixes: ['.hdr', '.exr'], most: 2 ** 28, take: panorama },
        { suffixes: ['.glb', '.obj', '.stl'], most: 2 ** 28, take: objects.add },
        { suffixes: ['.ply', '.spz', '.sog', '.splat', '.ksplat'], most: 2 ** 30, take: another }
    ];
    const dropped = (chosenFile) => {
        const kind = kinds.find((x) => x.suffixes.some((end) => chosenFile.name.toLowerCase().endsWith(end)));
        if (!kind) return say(`${chosenFile.name}: drop a panorama (.hdr, .exr), a mesh (.glb, .obj, .stl) or a capture (.ply, .spz, .sog, .splat)`);
        if (chosenFile.size > kind.most) return say(`${chosenFile.name} has more than ${kind.most / 2 ** 20} MB`);
        say('');
        find('news').textContent = `reading ${chosenFile.name}`;
        return kind.take(chosenFile);
    };
    const [file, meshFile, captureFile] = kinds.map(({ suffixes }) => picker(suffixes.join(), dropped));
    find('add-object').addEventListener('click', () => meshFile.click());
    find('open').addEventListener('click', () => captureFile.click());
    addEventListener('dragover', (event) => event.preventDefault());
    addEventListener('drop', (event) => {
        event.preventDefault();
        if (event.dataTransfer.files[0]) dropped(event.dataTransfer.files[0]);
    });
    const fit = () => {
        const panel = find('panel').getBoundingClientRect(), below = panel.width >= innerWidth;
        const folded = find('panel').classList.contains('folded');
        const width = innerWidth - (below || folded ? 0 : panel.width), height = innerHeight - (below ? panel.height : 0);
        view.resize(width, height);
        Object.assign(find('split').style, { left: '12px', width: `${width - 24}px` });
        find('split').style.top = `${height - 44}px`;
        seen();
    };
    find('title').textContent = find('title').title = studio.title.replace(/\.studio\.toml$|\.toml$/, '');
    document.title = `${find('title').textContent}: mirelight studio`;
    find('captured-said').textContent = studio.begun ? 'It is not known yet: an even one is assumed.' : 'As the job says.';
    find('panel').hidden = false;
    rows(); tabs(); marks(); cameraRows();
    fit();
    addEventListener('resize', fit);
    if (bookmark) view.go(bookmark);
    view.watch(seen);
    paint();
    follow();
    return { model, state: () => state, number: () => number, cameras: () => cameras, choose, go, actions };
}

// what is open, once something is
async function waited(message) {
    for (let asks = false; ;) {
        const studio = await (await fetch('live/studio')).json();
        if (studio.file) return studio;
        message.textContent = studio.trouble || (studio.opening ? `Looking at ${studio.opening.split('/').pop()}…` : '');
        find('drop').hidden = Boolean(studio.opening);
        if (!asks) {
            asks = true;
            const take = async (capture) => {
                message.textContent = `Reading ${capture.name}…`;
                try {
                    await send(`live/open/${encodeURIComponent(capture.name)}`, capture, AGAIN);
                } catch (error) {
                    message.textContent = error.message;
                }
            };
            find('capture').addEventListener('change', () => { if (find('capture').files[0]) take(find('capture').files[0]); });
            find('drop').addEventListener('dragover', (event) => event.preventDefault());
            find('drop').addEventListener('drop', (event) => {
                event.preventDefault();
                if (event.dataTransfer.files[0]) take(event.dataTransfer.files[0]);
            });
        }
        await new Promise((resolve) => setTimeout(resolve, 500));
    }
}

async function open() {
    const message = find('message');
    try {
        const studio = await waited(message);
        find('drop').hidden = true;
        const description = {
            ...studio, splats: { file: studio.file }, limit: null, layers: Array.from({ length: SLOTS }, () => ({ scale: 0 }))
        };
        const view = await createView(find('view'), description, null);
        const page = start(view, studio);
        message.hidden = true;
        return { view, ...page };
    } catch (error) {
        message.hidden = false;
        message.textContent = error.message;
        throw error;
    }
}

globalThis.studio = open();
