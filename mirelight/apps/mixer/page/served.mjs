// The page where it is served: lights are moved, stills are rendered, and the job is saved.
import { createLive } from './live.mjs';
import { factors } from './panel.mjs';

const find = (id) => document.getElementById(id);

// page: { mix(), text(), paint(), moved(place, position) }
export function serve(view, page) {
    const figure = find('still'), image = figure.querySelector('img'), split = find('split');
    let asked = null, touched = false, moving = 0, since = 0, said = '', next = null, held = 0;
    // what is to be read for some seconds stays so long; then comes the newest of what was said meanwhile
    const say = (text, seconds = 0) => {
        const left = held - performance.now();
        if (!seconds && left > 0) {
            next = text;
            return;
        }
        next = null;
        if (seconds) {
            held = performance.now() + 1000 * seconds;
            setTimeout(() => { if (next !== null) say(next); }, 1000 * seconds + 50);
        }
        if (text !== said) find('news').textContent = said = text;
    };
    const close = () => {
        if (!asked) return;
        asked = null;
        figure.hidden = true;
        find('render').setAttribute('aria-pressed', false);
        live.still({ number: null });
    };

    const live = createLive({
        layer(index, packed, scale) { view.replace(index, packed, scale); page.paint(); },
        still(blob, { number }) {
            if (number !== asked) return;
            URL.revokeObjectURL(image.src);
            image.src = URL.createObjectURL(blob);
            const [width, height] = view.size;
            Object.assign(figure.style, { width: `${width}px`, height: `${height}px` });
            figure.hidden = false;
        },
        state({ version, moved, tracing, done, still, trouble }) {
            // news that were on their way when a light was moved here would put it back
            if (!moving && version >= since) for (const { layer, light, position } of moved) page.moved({ layer, light }, position);
            const own = still && still.number === asked ? still : null;
            const share = (x) => `${Math.floor(100 * x)} %`;
            if (trouble) say(trouble);
            else if (own && own.state !== 'done') say(`Still: ${share(own.done)}`);
            else if (own) say('Still: done');
            else say(tracing ? `${tracing}: ${share(done)}` : '');
        },
        trouble: (text) => say(text, 5)
    });

    const ask = () => {
        const mix = page.mix(), eye = view.eye(), lighting = mix.lightings[mix.chosen];
        const [x, y, z, p] = [eye.right, eye.up, eye.forward.map((v) => -v), eye.position];
        asked = Math.max(Date.now(), (asked ?? 0) + 1);
        live.still({
            number: asked, lighting: mix.captured ? null : lighting.name, factors: factors(lighting),
            exposure: mix.exposure, fov: eye.fov * 180 / Math.PI, near: eye.near, width: eye.width, height: eye.height,
            pose: [0, 1, 2].flatMap((k) => [x[k], y[k], z[k], p[k]]).concat([0, 0, 0, 1])
        });
    };

    for (const kind of ['pointerdown', 'wheel', 'keydown']) {
        document.addEventListener(kind, () => { touched = true; }, { capture: true, passive: true });
    }
    split.addEventListener('input', () => figure.style.setProperty('--split', split.value));
    return {
        changed: close,
        // the camera has moved: of itself it comes to rest, and its view is asked for anew
        seen: () => { if (asked && !touched) ask(); else close(); },
        moved(handle, position) {
            close();
            moving++;
            live.move(handle.layer, handle.light, position)
                .then((version) => { since = version || since; })
                .finally(() => { moving--; });
        },
        render() {
            if (asked) return close();
            touched = false;
            find('render').setAttribute('aria-pressed', true);
            ask();
        },
        async save() {
            try {
                say(`Saved: ${await live.save(page.text())}`, 3);
            } catch (error) {
                say(error.message, 5);
            }
        }
    };
}
