// Which way is up, by hand: an arrow from what is looked at, dragged until it stands as it should.
import { length, plus } from './model.mjs';

// page: { line, focus(), away(), view, turn(way) }
export function createUpright(page) {
    let way = null, pulled = false;  // in the world, null: it is not turned; by the pointer
    const tip = () => plus(page.focus(), way, 0.3 * page.away());
    return {
        get on() { return way !== null; },
        toggle() { way = way ? null : [0, 1, 0]; },
        handles: () => (way ? [{ name: 'up', kind: 'Which way is', layer: -2, upright: true, now: tip }] : []),
        move(handle, position, ended) {
            const to = plus(position, page.focus(), -1);
            way = to.map((x) => x / (length(to) || 1));
            handle.position = tip();
            if (ended && pulled) this.pick();  // arrow keys may be pressed again
            pulled = !ended;
        },
        pick() {
            if (way?.[1] < 0.9999) page.turn(way);
        },
        // the arrow's shaft
        place() {
            const [from, to] = way ? [page.focus(), tip()].map(page.view.project) : [];
            page.line.hidden = !from || !to;
            if (page.line.hidden) return;
            const [x, y] = [to[0] - from[0], to[1] - from[1]];
            Object.assign(page.line.style, { width: `${Math.hypot(x, y)}px`, transform: `translate(${from[0]}px, ${from[1]}px) rotate(${Math.atan2(y, x)}rad)` });
        }
    };
}
