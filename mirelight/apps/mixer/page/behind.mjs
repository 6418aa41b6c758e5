// What stands behind the splats: light that the layers' weights mix, under the picture by what that lets through.
import * as pc from 'playcanvas';

const MAPS = 8, SUNS = 8;  // that are seen at once: those of two lightings, while one fades to the other

const each = (count, line) => Array.from({ length: count }, (_, i) => line(i)).join('\n');

// Tone curves and their inverses: splats come with theirs, light is added up without.
const CURVES = {
    none: `
vec3 curve(vec3 x) { return x; }
vec3 uncurved(vec3 y) { return y; }`,
    aces: `
vec3 curve(vec3 x) { return x * (2.51 * x + 0.03) / (x * (2.43 * x + 0.59) + 0.14); }
vec3 uncurved(vec3 y) {
    vec3 a = 2.51 - 2.43 * y, b = 0.03 - 0.59 * y;
    return (sqrt(b * b + 0.56 * a * y) - b) / (2.0 * a);
}`,
    neutral: `
vec3 curve(vec3 c) {
    float low = min(c.r, min(c.g, c.b));
    c -= low < 0.08 ? low - 6.25 * low * low : 0.04;
    float peak = max(c.r, max(c.g, c.b));
    if (peak < 0.76) return c;
    float most = 1.0 - 0.0576 / (peak - 0.52);
    return mix(vec3(most), c * most / peak, 1.0 / (0.15 * (peak - most) + 1.0));
}
vec3 uncurved(vec3 c) {
    float most = min(max(c.r, max(c.g, c.b)), 0.999);
    if (most >= 0.76) {
        float peak = 0.0576 / (1.0 - most) + 0.52;
        c = max(most + (c - most) * (0.15 * (peak - most) + 1.0), 0.0) * peak / most;
    }
    float low = sqrt(min(c.r, min(c.g, c.b)) / 6.25);
    return c + (low < 0.08 ? low - 6.25 * low * low : 0.04);
}`
};

const VERTEX = `
attribute vec2 vertex_position;
void main(void) { gl_Position = vec4(vertex_position, 0.0, 1.0); }`;

// As `mirelight.relighting.backdrop` has it: `fitted` of a picture, `seen` of surroundings, `without_leaks`.
const fragment = (picture, ground, tone) => `
uniform highp sampler2D uFront;
${each(MAPS, (i) => `uniform highp sampler2D uMap${i};`)}
uniform vec3 uMapWeight[${MAPS}];
uniform vec2 uMapTurn[${MAPS}];  // cosine and sine
uniform vec4 uSunTo[${SUNS}];  // direction to it, radius in radians
uniform vec3 uSunWeight[${SUNS}];
uniform vec3 uRight;  // to the picture's right edge, where its middle is uForward
uniform vec3 uUp;
uniform vec3 uForward;
uniform vec3 uEye;
uniform vec4 uPicture;  // width and height of the view, of its picture
uniform float uPixel;  // radians
uniform float uGain;  // exposure
uniform float uLit;  // 0: there is nothing behind
uniform vec4 uFloor;  // where the panorama was taken, radius
uniform float uHeight;  // of that place
const float PI = 3.14159265358979;
vec3 decoded(vec3 c) {
    return mix(c / 12.92, pow((max(c, 0.0) + 0.055) / 1.055, vec3(2.4)), vec3(greaterThan(c, vec3(0.04045))));
}
vec3 encoded(vec3 c) {
    return mix(c * 12.92, 1.055 * pow(max(c, 0.0), vec3(1.0 / 2.4)) - 0.055, vec3(greaterThan(c, vec3(0.0031308))));
}
${CURVES[tone] ?? CURVES.none}
vec2 place(vec3 way, vec2 turn) {
    vec2 level = vec2(turn.x * way.x - turn.y * way.z, turn.y * way.x + turn.x * way.z);
    return vec2(0.5 + atan(level.y, level.x) / (2.0 * PI), acos(clamp(way.y, -1.0, 1.0)) / PI);
}
vec3 sun(int i, vec3 way) {
    float radius = uSunTo[i].w;
    float angle = 2.0 * asin(clamp(0.5 * length(way - uSunTo[i].xyz), 0.0, 1.0));
    float share = clamp(0.5 + (max(radius, 0.5 * uPixel) - angle) / uPixel, 0.0, 1.0);
    return share * min(1.0, PI * radius * radius / (uPixel * uPixel)) * uSunWeight[i];
}
vec3 behind(vec2 at) {
${picture ? `
    float scale = min(uPicture.z / uPicture.x, uPicture.w / uPicture.y);
    vec2 share = scale * uPicture.xy / uPicture.zw;
    return uMapWeight[0] * textureLod(uMap0, 0.5 + 0.5 * share * vec2(at.x, -at.y), 0.0).rgb;` : `
    vec3 way = normalize(uForward + at.x * uRight + at.y * uUp), from = way;
    bool onFloor = false;
${ground ? `
    float down = (uFloor.y - uHeight - uEye.y) / way.y;
    vec3 met = uEye + down * way - uFloor.xyz;
    onFloor = down > 0.0 && way.y < 0.0 && dot(met.xz, met.xz) <= uFloor.w * uFloor.w - uHeight * uHeight;
    vec3 off = uEye - uFloor.xyz;
    float along = dot(off, way), inside = along * along - dot(off, off) + uFloor.w * uFloor.w;
    float far = sqrt(max(inside, 0.0)) - along;
    from = normalize(onFloor ? met : inside > 0.0 && far > 0.0 ? off + far * way : way);` : ''}
    vec3 light = vec3(0.0);
${each(MAPS, (i) => `    light += uMapWeight[${i}] * textureLod(uMap${i}, place(from, uMapTurn[${i}]), 0.0).rgb;`)}
    if (!onFloor) {
${each(SUNS, (i) => `        light += sun(${i}, way);`)}
    }
    return light;`}
}
void main(void) {
    vec4 front = texelFetch(uFront, ivec2(gl_FragCoord.xy), 0);
    gl_FragColor = vec4(front.rgb, 1.0);
    float through = 1.0 - front.a;
    if (uLit == 0.0 || through <= 0.0) return;
    // eight bits of next to nothing are no colour, of which a curve's inverse would make a glare
    float most = ${['aces', 'neutral'].includes(tone) ? 'mix(0.9, 1.0, front.a)' : '1.0'};
    vec3 own = front.a > 0.0 ? uncurved(decoded(min(front.rgb / front.a, most))) * front.a : vec3(0.0);
    float open = smoothstep(0.0, 0.1, through);
    vec3 light = behind(2.0 * gl_FragCoord.xy / uPicture.xy - 1.0) * uGain;
    gl_FragColor = vec4(encoded(curve(min(own + through * open * light, vec3(1e4)))), 1.0);
}`;

// described: what layers.json says of it; data: its file, an ArrayBuffer; tone: the job's curve
export function createBehind(device, described, data, tone) {
    const shader = pc.ShaderUtils.createShader(device, {
        uniqueName: 'behind', attributes: { vertex_position: pc.SEMANTIC_POSITION },
        vertexGLSL: VERTEX, fragmentGLSL: fragment(described.picture, described.ground, tone)
    });
    const across = described.picture ? pc.ADDRESS_CLAMP_TO_EDGE : pc.ADDRESS_REPEAT;
    const texture = (name, width, height, format, more) => new pc.Texture(device, {
        name, width, height, format, mipmaps: false, addressU: across, addressV: pc.ADDRESS_CLAMP_TO_EDGE, ...more
    });
    const linear = { minFilter: pc.FILTER_LINEAR, magFilter: pc.FILTER_LINEAR };
    const textures = described.maps.map(({ width, height, start }, i) => texture(
        `behind${i}`, width, height, pc.PIXELFORMAT_RGB9E5,
        { ...linear, levels: [new Uint32Array(data, 4 * start, width * height)] }));
    const none = texture('behind', 1, 1, pc.PIXELFORMAT_RGB9E5, { ...linear, levels: [new Uint32Array(1)] });
    const set = (name, value) => device.scope.resolve(name).setValue(value);
    let front = null, maps = [], suns = [], gain = 1;

    const resized = (width, height) => {
        if (front?.width === width && front.height === height) return;
        front?.destroyTextureBuffers();
        front?.destroy();
        const nearest = { minFilter: pc.FILTER_NEAREST, magFilter: pc.FILTER_NEAREST };
        const colorBuffer = texture('front', width, height, pc.PIXELFORMAT_RGBA8, nearest);
        front = new pc.RenderTarget({ name: 'front', colorBuffer, depth: false });
    };

    return {
        // weights: [r, g, b] of each layer; share: 0 as captured, 1 the mix; exposure in stops
        show(weights, share, exposure) {
            const seen = (every, most) => every.map((one, index) => {
                const weight = described.picture ? [1, 1, 1] : (weights[one.layer] ?? [0, 0, 0])
                    .map((x, c) => share * x + (1 - share) * one.captured[c]);
                return { ...one, index, weight: weight.map((x, c) => x * one.scale[c]) };
            }).filter(({ weight }) => weight.some((x) => x > 0)).slice(0, most);
            [maps, suns, gain] = [seen(described.maps, MAPS), seen(described.suns, SUNS), 2 ** exposure];
        },
        // over what the backbuffer has, whose alpha says what the splats cover
        draw({ position, right, up, forward, fov, width, height }) {
            resized(width, height);
            device.copyRenderTarget(null, front, true, false);
            const tangent = Math.tan(fov / 2), numbers = (count, from) => Float32Array.from(
                { length: count }, (_, k) => from(k) ?? 0);
            for (let i = 0; i < MAPS; i++) set(`uMap${i}`, textures[maps[i]?.index] ?? none);
            set('uMapWeight[0]', numbers(3 * MAPS, (k) => maps[Math.floor(k / 3)]?.weight[k % 3]));
            set('uMapTurn[0]', numbers(2 * MAPS, (k) => Math[k % 2 ? 'sin' : 'cos'](maps[k >> 1]?.rotation ?? 0)));
            set('uSunTo[0]', numbers(4 * SUNS, (k) => (k % 4 === 3 ? suns[k >> 2]?.radius : suns[k >> 2]?.to[k % 4])));
            set('uSunWeight[0]', numbers(3 * SUNS, (k) => suns[Math.floor(k / 3)]?.weight[k % 3]));
            set('uRight', right.map((x) => x * tangent * width / height));
            set('uUp', up.map((x) => x * tangent));
            set('uForward', forward);
            set('uEye', position);
            set('uPicture', [width, height, maps[0]?.width ?? 1, maps[0]?.height ?? 1]);
            set('uPixel', 2 * tangent / height);
            set('uGain', gain);
            set('uLit', maps.length || suns.length ? 1 : 0);
            if (described.ground) {
                const [x, y, z, high, radius] = described.ground;
                set('uFloor', [x, y + high, z, radius]);
                set('uHeight', high);
            }
            set('uFront', front.colorBuffer);
            device.setBlendState(pc.BlendState.NOBLEND);
            device.setCullMode(pc.CULLFACE_NONE);
            device.setDepthState(pc.DepthState.NODEPTH);
            device.setStencilState(null, null);
            pc.drawQuadWithShader(device, null, shader);
        }
    };
}
