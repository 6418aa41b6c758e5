// Inserted objects over the capture, as the server set them down, and what dragging makes of their tables.
import * as pc from 'playcanvas';
import { freeName, placed, plus, rounded } from './model.mjs';
import { thingRow } from './rows.mjs';

const CORNER = 16;  // bytes: three floats of its place, four bytes of its colour

function createMeshes(app) {
    const material = new pc.StandardMaterial();
    Object.assign(material, {
        useLighting: false, useFog: false, useTonemap: false, emissive: pc.Color.WHITE, emissiveVertexColor: true, cull: pc.CULLFACE_NONE
    });
    material.update();
    const layer = app.scene.layers.getLayerById(pc.LAYERID_WORLD);
    let instances = [];
    const forget = () => {
        layer.removeMeshInstances(instances);
        for (const one of instances) one.mesh.destroy();
        instances = [];
    };
    return {
        // told: of each its count of corners; data: all their places, then all their colours
        replace(told, data) {
            forget();
            const total = data.byteLength / CORNER;
            const places = new Float32Array(data, 0, 3 * total), colors = new Uint8Array(data, 12 * total, 4 * total);
            let first = 0;
            instances = told.map(({ count }) => {
                const mesh = new pc.Mesh(app.graphicsDevice);
                mesh.setPositions(places.subarray(3 * first, 3 * (first + count)));
                mesh.setColors32(colors.subarray(4 * first, 4 * (first + count)));
                mesh.update(pc.PRIMITIVE_TRIANGLES);
                first += count;
                const instance = new pc.MeshInstance(mesh, material, new pc.GraphNode());
                instance.cull = false;
                return instance;
            });
            layer.addMeshInstances(instances);
        },
        // by: [x, y, z] off where the server set it down
        shift(index, by) { instances[index]?.node.setLocalPosition(...by); },
        show(shown) { for (const one of instances) one.visible = shown; }
    };
}

// --- the tables ---

const canMove = (table) => !table.transform?.matrix;

const translation = (table) => table?.transform?.translation ?? [0, 0, 0];
// asked: where its foot would be if the ground did not decide; place: where that is to be
function moveThing(table, asked, place, away) {
    const at = translation(table);
    const free = !table.drop && !table.scatter;  // else the ground decides how high it stands
    if (table.scatter) { delete table.scatter; table.drop = true; }
    table.transform = { ...table.transform, translation: at.map((x, k) => (k === 1 && !free ? x : placed(x + place[k] - asked[k], away))) };
}

// degrees about the upright axis, as a job has them
const turnOf = (table) => table.transform?.rotation_euler?.[1] ?? 0;
// about its foot: asked as above
function turnThing(table, asked, degrees, away) {
    const [x, , z] = table.transform?.rotation_euler ?? [0, 0, 0], by = (degrees - turnOf(table)) * Math.PI / 180;
    const at = translation(table), [u, v] = [asked[0] - at[0], asked[2] - at[2]], [c, s] = [Math.cos(by), Math.sin(by)];
    const moved = [asked[0] - c * u - s * v, at[1], asked[2] + s * u - c * v];
    table.transform = {
        ...table.transform, translation: moved.map((value) => placed(value, away)),
        rotation_euler: [x, rounded(((degrees + 180) % 360 + 360) % 360 - 180, 4), z]
    };
}

// A table of a mesh with these bounds, before the camera: dropped from as high as the eye, in a size that shows.
function newThing(path, [low, high], name, { eye, away, beside }) {
    const size = Math.max(...high.map((x, k) => x - low[k]));
    const scale = size >= 0.02 * away && size <= 0.5 * away ? 1 : rounded(0.15 * away / size, 2);
    const flat = Math.hypot(eye.forward[0], eye.forward[2]) || 1;
    const aside = 0.25 * away * [0, -1, 1, -2, 2][beside % 5];
    const place = [0, 1, 2].map((k) => {
        if (k === 1) return eye.position[1] - scale * high[1];  // its top as high as the eye
        const ahead = eye.position[k] + 0.75 * away * eye.forward[k] / flat + aside * eye.right[k];
        return ahead - scale * (low[k] + high[k]) / 2;
    });
    return {
        path, name, drop: true,
        transform: { translation: place.map((x) => placed(x, away)), rotation_euler: [0, 0, 0], ...(scale === 1 ? {} : { scale }) }
    };
}

// page: { again(), away(), pick(id), sent(edit), number(), handles(), put(name, body), view }
export function createObjects(model, page) {
    const meshes = createMeshes(page.view.app);
    let version = 0, told = [], then = [], knows = -1, handles = [], held = null;
    const tables = () => model.job.objects ?? [];
    const find = (list, name) => list.find((x) => x.name === name);
    const change = (name, edit) => model.change(`object ${name}`, (job) => edit(find(job.objects, name)));
    const asked = (table) => {  // of the table as it is now: the server may know an older one
        const before = translation(find(then, table.name)), { asked: [...from] = before } = find(told, table.name) ?? {};
        return translation(table).map((x, k) => from[k] + x - before[k]);
    };
    const ours = (handle) => held === handle || knows < page.number();  // the server is told of newer places
    const ahead = (table, { place, size }) => {
        const angle = turnOf(table) * Math.PI / 180;
        return plus(place, [Math.sin(angle), 0, Math.cos(angle)], Math.max(0.75 * size, 0.12 * page.away()));
    };
    const turn = (name, degrees) => {
        const from = asked(find(tables(), name));
        change(name, (t) => turnThing(t, from, degrees, page.away()));
    };
    return {
        get signature() { return tables().map((x) => x.name); },
        show: meshes.show,
        // state: of the server, what it tells of objects
        async heard(state) {
            if (state.number < 0) return;
            if (state.version !== version) {
                const answer = await fetch(`live/objects/${state.version}`);
                if (!answer.ok) return;  // there is a newer one by now
                version = state.version;
                meshes.replace(state.told, await answer.arrayBuffer());
                page.view.wake();
            }
            const news = told.map((x) => x.name).join() !== state.told.map((x) => x.name).join();
            [told, then, knows] = [state.told, page.sent(state.number)?.objects ?? then, state.number];
            if (news) return page.handles();
            for (const handle of handles) {
                const [now, table] = [find(told, handle.thing), find(tables(), handle.thing)];
                if (!now || !table) continue;
                if (!ours(handle)) handle.position = handle.turns ? ahead(table, now) : now.place;
                else if (!handle.turns) meshes.shift(told.indexOf(now), [handle.position[0] - now.place[0], 0, handle.position[2] - now.place[2]]);
            }
        },
        handles() {
            const moved = { layer: -1, along: 'ground', kind: 'Object' };
            const shown = handles;
            handles = tables().filter(canMove).flatMap((table, i) => {
                const now = find(told, table.name);
                if (!now) return [];
                const stays = (name, place) => {
                    const before = find(shown, name);
                    return { ...moved, thing: table.name, layer: 1000 + i, name, position: before && ours(before) ? before.position : place };
                };
                return [{ ...stays(`${table.name}: turn`, ahead(table, now)), turns: true }, stays(table.name, now.place)];
            });
            return handles;
        },
        move(handle, position, ended) {
            const table = find(tables(), handle.thing), now = find(told, handle.thing);
            held = ended ? null : handle;
            handle.position = position;
            if (!table || !now) return;
            if (handle.turns) {
                const center = handles.find((x) => x.thing === handle.thing && !x.turns).position;
                const degrees = Math.round(Math.atan2(position[0] - center[0], position[2] - center[2]) * 180 / Math.PI);
                turn(handle.thing, degrees);
                page.tell(`${handle.thing}: Turn °`, degrees);
                if (ended) handle.position = ahead(find(tables(), handle.thing), { ...now, place: center });
            } else {
                const from = asked(table), by = plus(position, now.place, -1);
                change(handle.thing, (t) => moveThing(t, from, table.drop || table.scatter ? [position[0], from[1], position[2]] : plus(from, plus(position, now.place, -1)), page.away()));
                meshes.shift(told.indexOf(now), [by[0], table.drop ? 0 : by[1], by[2]]);
                page.view.wake();
            }
        },
        rows() {
            return tables().map((table) => thingRow(table, {
                canMove: canMove(table), turned: turnOf(table), turn: (degrees) => turn(table.name, degrees),
                set: (edit) => change(table.name, edit),
                remove: () => model.change(`remove ${table.name}`, (job) => {
                    job.objects = job.objects.filter((x) => x.name !== table.name);
                    if (!job.objects.length) delete job.objects;
                }),
                rename: (name) => {
                    page.again();
                    if (!name || find(tables(), name)) return page.rows();
                    change(table.name, (t) => { t.name = name; });
                }
            }));
        },
        async add(file) {
            const found = await page.put(`live/object/${encodeURIComponent(file.name)}`, file);
            if (!found) return;
            const name = freeName(file.name.replace(/\.\w+$/, ''), tables().map((x) => x.name));
            const table = newThing(found.path, found.bounds, name, { eye: page.view.eye(), away: page.away(), beside: tables().length });
            model.change(`add ${name}`, (job) => { (job.objects ??= []).push(table); });
        }
    };
}
