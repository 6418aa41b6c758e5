// Frames that are rendered: a row for each, its picture, and how far it is.
import { make } from './rows.mjs';

const WORDS = { waiting: 'waiting', running: 'rendering', done: 'done', failed: 'failed', ended: 'ended' };

// on: { open(render, url), cancel(number) }
export function createQueue(list, on) {
    const known = new Map();  // number -> { item, version, … }
    function create(render) {
        const image = make('img', { alt: '', hidden: true });
        const open = make('button', { type: 'button', className: 'thumb', disabled: true, ariaLabel: `Show ${render.camera}, ${render.lighting}` }, image);
        const name = make('span', { className: 'name', textContent: `${render.camera}, ${render.lighting}` });
        const said = make('span', { className: 'said' });
        const bar = make('progress', { max: 1, value: 0, ariaLabel: `Progress of ${render.camera}, ${render.lighting}` });
        const end = make('button', { type: 'button', className: 'small', textContent: 'End', ariaLabel: `End ${render.camera}, ${render.lighting}` });
        const entry = { image, open, said, bar, end, version: 0, url: '' };
        open.addEventListener('click', () => on.open(entry.render, entry.url));
        end.addEventListener('click', () => on.cancel(render.number));
        entry.item = make('li', {}, open, make('div', {}, name, said, bar), end);
        list.prepend(entry.item);
        return entry;
    }
    return {
        show(renders) {
            for (const render of renders) {
                const entry = known.get(render.number) ?? create(render);
                known.set(render.number, entry);
                entry.render = render;
                const busy = render.state === 'running' || render.state === 'waiting';
                const share = render.state === 'running' && render.done ? ` ${Math.floor(100 * render.done)} %` : '';
                entry.said.textContent = `${WORDS[render.state]}${share}${render.said ? `: ${render.said}` : ''}`;
                entry.said.title = render.file || render.said;
                entry.bar.value = render.done;
                entry.bar.hidden = entry.end.hidden = !busy;
                if (render.version !== entry.version) {
                    entry.version = render.version;
                    entry.url = `live/picture/${render.number}/${render.version}`;
                    entry.image.src = entry.url;
                    entry.image.hidden = entry.open.disabled = false;
                    entry.open.disabled = false;
                }
            }
        },
        entry: (number) => known.get(number)
    };
}
