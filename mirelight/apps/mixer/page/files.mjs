// Loads what mirelight mix wrote, and sees that it belongs together.

const K = Uint32Array.from({ length: 64 }, (_, i) => {
    let n = 2, count = -1;
    for (;; n++) {
        let prime = true;
        for (let d = 2; d * d <= n; d++) if (n % d === 0) { prime = false; break; }
        if (prime && ++count === i) break;
    }
    return Math.floor((Math.cbrt(n) % 1) * 2 ** 32);
});

async function get(name) {
    let answer;
    try {
        answer = await fetch(name);
    } catch {
        throw new Error(`${name} cannot be loaded: the server does not answer`);
    }
    if (!answer.ok) throw new Error(`${name} cannot be loaded (${answer.status}): run mirelight mix again`);
    return answer;
}

// SHA-256 (FIPS 180-4). Browsers have one of their own, but on secure pages and localhost alone.
export async function sha256(buffer) {
    const hex = (words) => [...words].map((x) => x.toString(16).padStart(8, '0')).join('');
    if (globalThis.crypto?.subtle) {
        const view = new DataView(await crypto.subtle.digest('SHA-256', buffer));
        return hex(Array.from({ length: 8 }, (_, i) => view.getUint32(4 * i)));
    }
    return hex(plainSha256(new Uint8Array(buffer)));
}

export function plainSha256(bytes) {
    const h = Uint32Array.of(0x6a09e667, 0xbb67ae85, 0x3c6ef372, 0xa54ff53a, 0x510e527f, 0x9b05688c, 0x1f83d9ab, 0x5be0cd19);
    const w = new Uint32Array(64);
    const whole = bytes.length & ~63;
    const tail = new Uint8Array(bytes.length - whole < 56 ? 64 : 128);
    tail.set(bytes.subarray(whole));
    tail[bytes.length - whole] = 0x80;
    new DataView(tail.buffer).setBigUint64(tail.length - 8, BigInt(bytes.length) * 8n);
    const turn = (x, n) => (x >>> n) | (x << (32 - n));
    const block = (from, at) => {
        for (let i = 0; i < 16; i++) {
            const k = at + 4 * i;
            w[i] = (from[k] << 24) | (from[k + 1] << 16) | (from[k + 2] << 8) | from[k + 3];
        }
        for (let i = 16; i < 64; i++) {
            const a = w[i - 15], b = w[i - 2];
            w[i] = w[i - 16] + w[i - 7] + (turn(a, 7) ^ turn(a, 18) ^ (a >>> 3)) + (turn(b, 17) ^ turn(b, 19) ^ (b >>> 10));
        }
        let [a, b, c, d, e, f, g, last] = h;
        for (let i = 0; i < 64; i++) {
            const one = (last + (turn(e, 6) ^ turn(e, 11) ^ turn(e, 25)) + ((e & f) ^ (~e & g)) + K[i] + w[i]) | 0;
            const two = ((turn(a, 2) ^ turn(a, 13) ^ turn(a, 22)) + ((a & b) ^ (a & c) ^ (b & c))) | 0;
            [last, g, f, e, d, c, b, a] = [g, f, e, (d + one) | 0, c, b, a, (one + two) | 0];
        }
        [a, b, c, d, e, f, g, last].forEach((x, i) => { h[i] += x; });
    };
    for (let at = 0; at < whole; at += 64) block(bytes, at);
    for (let at = 0; at < tail.length; at += 64) block(tail, at);
    return h;
}

export async function loadFiles() {
    const description = await (await get('layers.json')).json().catch(() => {
        throw new Error('layers.json is damaged: run mirelight mix again');
    });
    const files = [description.splats, description.light, ...(description.behind ? [description.behind] : [])];
    const [splats, layers, behind] = await Promise.all(files.map(async ({ file }) => (await get(file)).arrayBuffer()));
    const is = async (data, { bytes, sha256: wanted }) => data.byteLength === bytes && await sha256(data) === wanted;
    if (!await is(splats, description.splats)) {
        throw new Error(`${description.splats.file} is not the file that the layers were made for: run mirelight mix again`);
    }
    if (!await is(layers, description.light)) {
        throw new Error(`${description.light.file} is not the file that layers.json describes: run mirelight mix again`);
    }
    if (behind && !await is(behind, description.behind)) {
        throw new Error(`${description.behind.file} is not the file that layers.json describes: run mirelight mix again`);
    }
    return { description, layers: new Uint32Array(layers), behind };
}
