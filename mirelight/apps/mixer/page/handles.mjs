// Lights drawn over the picture, each a button: picked by mouse, touch and keyboard, and dragged where the page is served.

const STEP = 0.02;  // of the distance to the camera, for a press of an arrow key
const ARROWS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };

const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const plus = (a, b, s = 1) => a.map((x, k) => x + s * b[k]);

// Where a light goes when it is seen (x, y) pixels further right and down: in the plane that faces the camera; with
// `along` "ground" in the plane across `up`, with "height" along `up`.
export function dragged(position, [x, y], along, eye) {
    const depth = dot(plus(position, eye.position, -1), eye.forward);
    const size = 2 * depth * Math.tan(eye.fov / 2) / eye.height;  // of a pixel there
    const facing = plus(plus(position, eye.right, x * size), eye.up, -y * size);
    if (along === 'height') return plus(position, eye.world, dot(plus(facing, position, -1), eye.world));
    if (along !== 'ground') return facing;
    const ray = plus(facing, eye.position, -1);
    const reach = dot(plus(position, eye.position, -1), eye.world) / dot(ray, eye.world);
    // towards the horizon the plane is never met, or far away
    return reach > 0 && reach < 8 ? plus(eye.position, ray, reach) : position;
}

const along = (event, handle) => (event.altKey ? 'height' : event.shiftKey || handle.along === 'ground' ? 'ground' : 'view');

// on: { pick(handle), move(handle, position, ended) }; without `move` handles are picked only.
// A handle has a name, a position, a layer, and what it is if no light (`kind`); `along` "ground": where it stays.
export function createHandles(container, view, on) {
    let shown = [];
    const place = () => {
        for (const { button, handle } of shown) {
            const at = view.project(handle.position);
            button.hidden = !at;
            if (at) button.style.transform = `translate(${at[0].toFixed(1)}px, ${at[1].toFixed(1)}px)`;
        }
    };

    function create(handle) {
        const button = document.createElement('button');
        Object.assign(button, { type: 'button', className: 'handle', title: handle.name, ariaLabel: `${handle.kind ?? 'Light'} ${handle.name}` });
        button.addEventListener('click', () => on.pick(handle));
        let from = null, began = null, last = null;
        const end = () => {
            if (last) on.move(handle, handle.position, true);
            from = last = null;
        };
        if (on.move) {
            button.classList.add('movable');
            button.addEventListener('pointerdown', (event) => {
                if (event.button !== 0) return;
                event.stopPropagation();
                button.setPointerCapture(event.pointerId);
                [from, began, last] = [[event.clientX, event.clientY], [...handle.position], null];
            });
            const follow = (event) => {
                last = [event.clientX - from[0], event.clientY - from[1]];
                on.move(handle, dragged(began, last, along(event, handle), view.eye()), false);
                place();
            };
            button.addEventListener('pointermove', (event) => {
                if (!from) return;
                event.stopPropagation();
                follow(event);
            });
            button.addEventListener('pointerup', (event) => {
                if (last) follow(event);  // a busy page is not told of every move
                end();
            });
            button.addEventListener('pointercancel', end);
        }
        button.addEventListener('keydown', (event) => {
            const arrow = ARROWS[event.key];
            if (!arrow) return;
            event.preventDefault();
            event.stopPropagation();  // the camera listens, too
            if (!on.move || event.ctrlKey || event.metaKey) return;
            const eye = view.eye();
            const step = STEP * eye.height / (2 * Math.tan(eye.fov / 2));
            on.move(handle, dragged(handle.position, [arrow[0] * step, -arrow[1] * step], along(event, handle), eye), true);
            place();
        });
        return { button, handle };
    }

    return {
        place,
        show(handles) {
            shown = handles.map(create);
            container.replaceChildren(...shown.map(({ button }) => button));
            place();
        },
        select(layer) {
            for (const { button, handle } of shown) button.setAttribute('aria-pressed', handle.layer === layer);
        }
    };
}
