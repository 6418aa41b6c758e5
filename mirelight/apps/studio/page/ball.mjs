// A mirror ball: what comes from far away, as the camera would see it in one. Dragged, it turns the light.

const RADIANS = Math.PI / 180;
const STEP = 5;  // degrees for a press of an arrow key

// turn(degrees): to the right, which is counter-clockwise seen from above; without it the ball only shows
export function createBall(canvas, turn) {
    const { width, height } = canvas, radius = width / 2;
    const context = canvas.getContext('2d'), out = context.createImageData(width, height);
    let map = null, url = '';

    function draw(eye, turned = 0) {
        canvas.hidden = !map;
        if (!map) return;
        const { right, up, forward } = eye;
        for (let y = 0; y < height; y++) for (let x = 0; x < width; x++) {
            const a = (x + 0.5) / radius - 1, b = 1 - (y + 0.5) / radius, c = Math.sqrt(Math.max(1 - a * a - b * b, 0));
            const to = 4 * (y * width + x), edge = radius * (1 - Math.hypot(a, b));
            out.data[to + 3] = 255 * Math.min(Math.max(edge + 0.5, 0), 1);
            // the ray along the view is mirrored by the ball's normal (a, b, -c)
            const [rx, ry, rz] = right.map((_, k) => 2 * c * (a * right[k] + b * up[k] - c * forward[k]) + forward[k]);
            const u = 0.5 + (Math.atan2(rz, rx) + turned * RADIANS) / (2 * Math.PI), v = Math.acos(Math.min(Math.max(ry, -1), 1)) / Math.PI;
            const column = Math.floor((u - Math.floor(u)) * map.width) % map.width, row = Math.min(Math.floor(v * map.height), map.height - 1);
            const from = 4 * (row * map.width + column);
            for (let k = 0; k < 3; k++) out.data[to + k] = map.data[from + k];
        }
        context.putImageData(out, 0, 0);
    }
    if (turn) {
        let last = null;
        canvas.addEventListener('pointerdown', (event) => {
            canvas.setPointerCapture(event.pointerId);
            last = event.clientX;
        });
        canvas.addEventListener('pointermove', (event) => {
            if (last === null || event.clientX === last) return;
            turn(2 * (event.clientX - last) / radius / RADIANS);  // what is mirrored in the middle follows the pointer
            last = event.clientX;
        });
        for (const kind of ['pointerup', 'pointercancel']) canvas.addEventListener(kind, () => { last = null; });
        canvas.addEventListener('keydown', (event) => {
            const way = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
            if (!way) return;
            event.preventDefault();
            event.stopPropagation();  // the camera listens, too
            turn(STEP * way);
        });
    }
    return {
        draw,
        // address: of an equirectangular picture; '': nothing comes from far away
        async load(address) {
            if (address === url) return;
            url = address;
            if (!address) { map = null; return; }
            const image = new Image();
            image.src = address;
            try {
                await image.decode();
            } catch {
                return;  // there is a newer one by now
            }
            if (address !== url) return;
            const flat = new OffscreenCanvas(image.width, image.height).getContext('2d');
            flat.drawImage(image, 0, 0);
            map = flat.getImageData(0, 0, image.width, image.height);
        }
    };
}
