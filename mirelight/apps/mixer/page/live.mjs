// What a page that is served asks of its server: lights that are traced anew, stills, and the job saved.

export async function send(name, body, again = 'start mirelight mix --serve again') {
    let answer;
    try {
        const plain = typeof body === 'string' || body instanceof Blob;
        answer = await fetch(name, { method: 'PUT', body: plain ? body : JSON.stringify(body) });
    } catch {
        throw new Error(`the server does not answer: ${again}`);
    }
    const text = await answer.text();
    if (!answer.ok) throw new Error(answer.status === 422 ? text : `the server refuses ${name} (${answer.status})`);
    return text;
}

// Sends bodies of one key one after another; what comes while one is on its way waits, and only the newest is sent.
export function createNewest(trouble, again) {
    const sending = new Map();
    return async (name, key, body) => {
        const busy = sending.has(key);
        sending.set(key, body);
        if (busy) return;
        let answer;
        try {
            while (sending.get(key)) {
                const now = sending.get(key);
                sending.set(key, null);
                answer = await send(name, now, again);
            }
            return answer;
        } catch (error) {
            trouble(error.message);
        } finally {
            sending.delete(key);
        }
    };
}

// on: { layer(index, packed, scale), state(state), still(url, state), trouble(line) }
export function createLive(on) {
    const known = new Map();  // layer -> version
    let still = 0, stopped = false;
    const newest = createNewest(on.trouble);

    async function news(after) {
        const answer = await fetch(`live/state?after=${after}`);
        if (!answer.ok) throw new Error(String(answer.status));
        const state = await answer.json();
        for (const { layer, version, scale } of state.layers) {
            if (known.get(layer) === version) continue;
            const made = await fetch(`live/layer/${layer}/${version}`);
            if (!made.ok) continue;  // there is a newer one by now
            on.layer(layer, new Uint32Array(await made.arrayBuffer()), scale);
            known.set(layer, version);
        }
        if (state.still?.version && state.still.version !== still) {
            const made = await fetch(`live/still/${state.still.version}`);
            if (made.ok) {
                still = state.still.version;
                on.still(await made.blob(), state.still);
            }
        }
        on.state(state);
        return state.version;
    }

    async function follow() {
        let after = 0;
        while (!stopped) {
            try {
                after = await news(after);
            } catch {
                on.trouble('the server does not answer: start mirelight mix --serve again');
                await new Promise((resolve) => setTimeout(resolve, 2000));
            }
        }
    }

    follow();
    return {
        // the version of the first news that know of it
        move: (layer, light, position) => newest('live/light', `${layer} ${light}`, { layer, light, position }).then(Number),
        still: (view) => newest('live/still', 'still', view),
        save: (text) => send('mix.toml', text),
        stop: () => { stopped = true; }
    };
}
