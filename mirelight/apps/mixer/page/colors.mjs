// Colours: the picker's sRGB, linear Rec.709, and colours of black bodies.

export const decode = (x) => (x <= 0.04045 ? x / 12.92 : ((x + 0.055) / 1.055) ** 2.4);
export const encode = (x) => (x <= 0.0031308 ? 12.92 * x : 1.055 * x ** (1 / 2.4) - 0.055);

export const linear = (hex) => [1, 3, 5].map((i) => decode(parseInt(hex.slice(i, i + 2), 16) / 255));

export const picker = (rgb) => '#' + rgb.map((x) =>
    Math.round(255 * encode(Math.min(Math.max(x, 0), 1))).toString(16).padStart(2, '0')).join('');

// A factor as the slider's strength and the picker's colour, whose largest channel is full.
export function split(factor) {
    const strength = Math.max(...factor);
    return { strength, hex: strength > 0 ? picker(factor.map((x) => x / strength)) : '#ffffff' };
}

// A black body's colour (the Planckian locus of Kim et al. 2002, 1667 to 25000 K), its largest channel 1.
export function blackBody(kelvin) {
    const t = 1000 / kelvin;
    const x = kelvin < 4000
        ? ((-0.2661239 * t - 0.2343589) * t + 0.8776956) * t + 0.17991
        : ((-3.0258469 * t + 2.1070379) * t + 0.2226347) * t + 0.24039;
    const y = kelvin < 2222
        ? ((-1.1063814 * x - 1.3481102) * x + 2.18555832) * x - 0.20219683
        : kelvin < 4000
            ? ((-0.9549476 * x - 1.37418593) * x + 2.09137015) * x - 0.16748867
            : ((3.081758 * x - 5.8733867) * x + 3.75112997) * x - 0.37001483;
    const [X, Z] = [x / y, (1 - x - y) / y];
    const rgb = [
        3.2404542 * X - 1.5371385 - 0.4985314 * Z,
        -0.969266 * X + 1.8760108 + 0.041556 * Z,
        0.0556434 * X - 0.2040259 + 1.0572252 * Z
    ].map((c) => Math.max(c, 0));
    const top = Math.max(...rgb);
    return rgb.map((c) => c / top);
}
