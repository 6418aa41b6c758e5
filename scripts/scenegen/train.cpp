// Trains Gaussian splats from pictures, as Kerbl, Kopanas, Leimkuehler and Drettakis 2023 ("3D Gaussian Splatting for
// Real-Time Radiance Field Rendering") describe it: projected Gaussians blended front to back, a loss of 0.8 L1 and
// 0.2 D-SSIM, Adam, clones, splits, pruning and opacity resets. scenegen/training.py compiles and runs it:
//
//     train DATA RESULT ITERATIONS MOST_SPLATS grown|moved|flat [DEGREE START]
//
// moved: as Kheradmand and others 2024 ("3D Gaussian Splatting as Markov Chain Monte Carlo") do it: splats that have
// become faint move to where others are opaque, few are added at a time, all are shaken, and opacity and width cost.
// flat: grown, but each has no width along its third axis and begins turned at random, as those of Huang and others 2024
// ("2D Gaussian Splatting"); what these add to the loss to straighten them is left out.
//
// START: rows of splats that are good already, as RESULT has them. Training goes on from there with harmonics of at most
// DEGREE: places move a tenth as fast, and opacities are not reset.
//
// Sums are made in an order that no number of threads changes, so one machine makes the same bits each time.
#include <omp.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <numeric>
#include <random>
#include <vector>

using Floats = std::vector<float>;

// A splat's row: position, log of the deviations, quaternion (w first), logit of the opacity, 16 x RGB harmonics.
constexpr int POSITION = 0, SCALE = 3, TURN = 6, OPACITY = 10, COLOUR = 11, ROW = 59;
constexpr int TILE = 16;
constexpr int MEASURED = 9;  // a print's gradients: place (2), conic (3), opacity, colour (3)
constexpr float BLUR = 0.3f;  // px^2 that every print is widened by
constexpr float FAINT = 1 / 255.f, OPAQUE = 0.99f, SPENT = 1e-4f;
constexpr float NEAREST = 0.05f;  // world units
constexpr float RESET = 0.01f, LEAST_OPACITY = 0.005f;
constexpr float GOING_ON = 0.1f;  // how fast places move that are good already
constexpr float WANTED = 2e-4f;  // mean gradient of a place, in half pictures, above which a splat is not enough
constexpr float SMALL = 0.01f, LARGE = 0.1f;  // of the cameras' extent: cloned below, pruned above
constexpr float MORE = 0.05f;  // of the splats are added at a time, where they are moved
constexpr float COST = 0.01f;  // of opacity, and of a deviation by the cameras' extent, as a share of the loss
constexpr float SHAKE = 5e5f, SHAKEN = 100, UNSHAKEN = 0.995f;  // by rate of places; how sharply the opaque stay
constexpr float FLAT = 1e-6f;  // of the cameras' extent: a width that is none
constexpr float HARMONIC = 0.28209479177387814f;

struct Camera {
    float turn[9], shift[3];  // world to camera, rows; x right, y down, z ahead
    float fx, fy, cx, cy;
    float eye[3];
};

struct Picture {
    Camera camera;
    Floats pixels;                   // 3 planes
    Floats means[3], squares[3];     // blurred, for the SSIM; filled at first use
};

struct Print {  // a splat as a camera sees it
    int splat, first, x0, x1, y0, y1;  // its first pair, its tiles (the ends are not in them)
    float depth, x, y, a, b, c, opacity, colour[3];
    float reach_y;
    bool dark[3];  // a channel below 0, which is clamped
};

struct Shape {  // what the way from parameters to a print has on it
    float at[3], limited[2], spread[6], turn[9], deviation[3], axes[9], covariance[9], unit[4], length;
    bool clamped[2];
};

static int width, height, tiles_x, tiles_y;
static float extent;
static int highest = 3;  // degree of the harmonics
static bool going_on = false, moved = false, flat = false;
static Floats rows, gradients, momenta, variances;
static std::vector<float> place_gradients;
static std::vector<int> place_counts;

static int count() { return int(rows.size() / ROW); }
static float sigmoid(float x) { return 1 / (1 + std::exp(-x)); }
static float logit(float x) { return std::log(x / (1 - x)); }

static void rotation(const float* q, float* r) {
    const float w = q[0], x = q[1], y = q[2], z = q[3];
    const float made[9] = {1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y),
                           2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x),
                           2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)};
    std::copy(made, made + 9, r);
}

static void unit_turn(const float* row, float* q, float& length) {
    length = std::sqrt(row[0] * row[0] + row[1] * row[1] + row[2] * row[2] + row[3] * row[3]) + 1e-12f;
    for (int k = 0; k < 4; k++) q[k] = row[k] / length;
}

// Real spherical harmonics to degree 3, in the signs and order of splat files.
static void harmonics(const float* d, int degree, float* b) {
    const float x = d[0], y = d[1], z = d[2], xx = x * x, yy = y * y, zz = z * z;
    std::fill(b, b + 16, 0.f);
    b[0] = HARMONIC;
    if (degree > 0) {
        const float k = 0.4886025119029199f;
        b[1] = -k * y, b[2] = k * z, b[3] = -k * x;
    }
    if (degree > 1) {
        const float k = 1.0925484305920792f;
        b[4] = k * x * y, b[5] = -k * y * z, b[7] = -k * x * z, b[8] = k / 2 * (xx - yy);
        b[6] = 0.31539156525252005f * (2 * zz - xx - yy);
    }
    if (degree > 2) {
        const float k = 0.5900435899266435f, m = 0.4570457994644658f, n = 2.890611442640554f;
        b[9] = -k * y * (3 * xx - yy), b[10] = n * x * y * z, b[11] = -m * y * (4 * zz - xx - yy);
        b[12] = 0.3731763325901154f * z * (2 * zz - 3 * xx - 3 * yy);
        b[13] = -m * x * (4 * zz - xx - yy), b[14] = n / 2 * z * (xx - yy), b[15] = -k * x * (xx - 3 * yy);
    }
}

static void towards(const float* row, const Camera& camera, float* d) {
    float squared = 0;
    for (int k = 0; k < 3; k++) d[k] = row[POSITION + k] - camera.eye[k], squared += d[k] * d[k];
    for (int k = 0; k < 3; k++) d[k] /= std::sqrt(squared);
}

// False: it is behind the camera.
static bool shape_of(const float* row, const Camera& c, Shape& s) {
    for (int r = 0; r < 3; r++) {
        s.at[r] = c.shift[r];
        for (int k = 0; k < 3; k++) s.at[r] += c.turn[3 * r + k] * row[POSITION + k];
    }
    const float z = s.at[2];
    if (z < NEAREST) return false;
    const float wide = 1.3f * c.cx / c.fx, high = 1.3f * c.cy / c.fy;  // beyond, the projection bends too much
    s.clamped[0] = std::fabs(s.at[0] / z) > wide, s.clamped[1] = std::fabs(s.at[1] / z) > high;
    s.limited[0] = std::clamp(s.at[0] / z, -wide, wide) * z, s.limited[1] = std::clamp(s.at[1] / z, -high, high) * z;
    for (int k = 0; k < 3; k++) {
        s.spread[k] = c.fx / z * (c.turn[k] - s.limited[0] / z * c.turn[6 + k]);
        s.spread[3 + k] = c.fy / z * (c.turn[3 + k] - s.limited[1] / z * c.turn[6 + k]);
    }
    unit_turn(row + TURN, s.unit, s.length);
    rotation(s.unit, s.turn);
    for (int k = 0; k < 3; k++) s.deviation[k] = std::exp(row[SCALE + k]);
    for (int r = 0; r < 9; r++) s.axes[r] = s.turn[r] * s.deviation[r % 3];
    for (int r = 0; r < 3; r++)
        for (int k = 0; k < 3; k++) {
            float sum = 0;
            for (int j = 0; j < 3; j++) sum += s.axes[3 * r + j] * s.axes[3 * k + j];
            s.covariance[3 * r + k] = sum;
        }
    return true;
}

static bool print_of(int i, const Camera& camera, int degree, Print& p) {
    const float* row = &rows[size_t(i) * ROW];
    Shape s;
    p.opacity = sigmoid(row[OPACITY]);
    if (p.opacity < FAINT || !shape_of(row, camera, s)) return false;
    float xx = BLUR, xy = 0, yy = BLUR;
    for (int r = 0; r < 3; r++)
        for (int k = 0; k < 3; k++) {
            const float v = s.covariance[3 * r + k];
            xx += s.spread[r] * v * s.spread[k], xy += s.spread[r] * v * s.spread[3 + k];
            yy += s.spread[3 + r] * v * s.spread[3 + k];
        }
    const float determinant = xx * yy - xy * xy;
    if (!(determinant > 0)) return false;
    p.splat = i, p.depth = s.at[2];
    p.x = camera.fx * s.at[0] / s.at[2] + camera.cx, p.y = camera.fy * s.at[1] / s.at[2] + camera.cy;
    p.a = yy / determinant, p.b = -xy / determinant, p.c = xx / determinant;
    const float reach = 2 * std::log(255 * p.opacity), reach_x = std::sqrt(reach * xx);
    p.reach_y = std::sqrt(reach * yy);
    if (!(std::fabs(p.x) < 1e6f && std::fabs(p.y) < 1e6f && reach_x < 1e6f && p.reach_y < 1e6f)) return false;
    p.x0 = std::clamp(int(std::floor((p.x - reach_x) / TILE)), 0, tiles_x);
    p.x1 = std::clamp(int(std::floor((p.x + reach_x) / TILE)) + 1, 0, tiles_x);
    p.y0 = std::clamp(int(std::floor((p.y - p.reach_y) / TILE)), 0, tiles_y);
    p.y1 = std::clamp(int(std::floor((p.y + p.reach_y) / TILE)) + 1, 0, tiles_y);
    if (p.x0 >= p.x1 || p.y0 >= p.y1) return false;
    float d[3], b[16];
    towards(row, camera, d);
    harmonics(d, degree, b);
    for (int c = 0; c < 3; c++) {
        float v = 0.5f;
        for (int k = 0; k < 16; k++) v += b[k] * row[COLOUR + 3 * k + c];
        p.dark[c] = v < 0, p.colour[c] = std::max(v, 0.f);
    }
    return true;
}

struct View {  // all prints of a camera, front to back, and which tile has which; a pair is a print in a tile
    std::vector<Print> prints;
    std::vector<std::vector<std::pair<int, int>>> tiles;  // (print, pair)
    int pairs = 0;
    Floats image;  // 3 planes of whole tiles
    int stride = 0, lines = 0;

    void look(const Camera& camera, int degree) {
        static std::vector<Print> all;
        static std::vector<char> seen;
        const int n = count();
        all.resize(n), seen.assign(n, 0);
#pragma omp parallel for schedule(static)
        for (int i = 0; i < n; i++) seen[i] = print_of(i, camera, degree, all[i]);
        prints.clear();
        for (int i = 0; i < n; i++)
            if (seen[i]) prints.push_back(all[i]);
        std::sort(prints.begin(), prints.end(), [](const Print& p, const Print& q) {
            return p.depth < q.depth || (p.depth == q.depth && p.splat < q.splat);
        });
        tiles.resize(size_t(tiles_x) * tiles_y);
        for (auto& tile : tiles) tile.clear();
        pairs = 0;
        for (int k = 0; k < int(prints.size()); k++) {
            Print& p = prints[k];
            p.first = pairs;
            for (int y = p.y0; y < p.y1; y++)
                for (int x = p.x0; x < p.x1; x++) tiles[size_t(y) * tiles_x + x].push_back({k, pairs++});
        }
        stride = tiles_x * TILE, lines = tiles_y * TILE;
        image.assign(size_t(3) * stride * lines, 0.f);
    }
};

// e^x for x <= 0, in a form that compilers make vectors of.
static inline float power(float x) {
    const float t = std::max(x, -40.f) * 1.44269504f, whole = std::floor(t + 0.5f), f = (t - whole) * 0.69314718f;
    const float p = 1 + f * (1 + f * (0.5f + f * (1 / 6.f + f * (1 / 24.f + f * (1 / 120.f + f / 720)))));
    const int32_t bits = (int32_t(whole) + 127) << 23;
    float scale;
    std::memcpy(&scale, &bits, 4);
    return p * scale;
}

struct Block {  // pixels of a tile
    float clear[TILE][TILE];

    Block() { std::fill(&clear[0][0], &clear[0][0] + TILE * TILE, 1.f); }
    bool spent() const {
        return *std::max_element(&clear[0][0], &clear[0][0] + TILE * TILE) < SPENT;
    }
};

static void lines_of(const Print& p, int top, int& from, int& to) {
    from = std::max(0, int(std::floor(p.y - p.reach_y - 0.5f)) - top);
    to = std::min(TILE, int(std::ceil(p.y + p.reach_y - 0.5f)) - top + 1);
}

static void blend(View& v) {
    const size_t plane = size_t(v.stride) * v.lines;
#pragma omp parallel for schedule(dynamic, 4)
    for (int t = 0; t < tiles_x * tiles_y; t++) {
        const int left = t % tiles_x * TILE, top = t / tiles_x * TILE;
        Block block;
        float sum[3][TILE][TILE] = {};
        int done = 0;
        for (const auto& [k, pair] : v.tiles[t]) {
            const Print& p = v.prints[k];
            int from, to;
            lines_of(p, top, from, to);
            for (int y = from; y < to; y++) {
                const float dy = top + y + 0.5f - p.y;
                float *clear = block.clear[y], *r = sum[0][y], *g = sum[1][y], *b = sum[2][y];
#pragma omp simd
                for (int x = 0; x < TILE; x++) {
                    const float dx = left + x + 0.5f - p.x;
                    const float e = power(-0.5f * (p.a * dx * dx + p.c * dy * dy) - p.b * dx * dy);
                    float alpha = std::min(OPAQUE, p.opacity * e);
                    alpha = alpha < FAINT || clear[x] < SPENT ? 0 : alpha;
                    const float weight = clear[x] * alpha;
                    clear[x] -= weight;
                    r[x] += weight * p.colour[0], g[x] += weight * p.colour[1], b[x] += weight * p.colour[2];
                }
            }
            if (++done % 32 == 0 && block.spent()) break;
        }
        for (int c = 0; c < 3; c++)
            for (int y = 0; y < TILE; y++)
                std::copy(sum[c][y], sum[c][y] + TILE, &v.image[c * plane + size_t(top + y) * v.stride + left]);
    }
}

// What the loss's gradient by pixels is by every pair's place, conic, opacity and colour.
//
// With w_i = T_i a_i the colour is sum w_i c_i, and d colour / d a_i = T_i c_i - (sum of w_j c_j behind i) / (1 - a_i):
// what is behind is the whole less what has been passed, so one sweep from the front does.
static void unblend(const View& v, const Floats& by_pixel, Floats& by_pair) {
    const size_t plane = size_t(v.stride) * v.lines;
    by_pair.assign(size_t(v.pairs) * MEASURED, 0.f);
#pragma omp parallel for schedule(dynamic, 4)
    for (int t = 0; t < tiles_x * tiles_y; t++) {
        const int left = t % tiles_x * TILE, top = t / tiles_x * TILE;
        Block block;
        float by[3][TILE][TILE], behind[TILE][TILE] = {};
        for (int c = 0; c < 3; c++)
            for (int y = 0; y < TILE; y++) {
                const size_t at = c * plane + size_t(top + y) * v.stride + left;
                std::copy(&by_pixel[at], &by_pixel[at] + TILE, by[c][y]);
                for (int x = 0; x < TILE; x++) behind[y][x] += by[c][y][x] * v.image[at + x];
            }
        int done = 0;
        for (const auto& [k, pair] : v.tiles[t]) {
            const Print& p = v.prints[k];
            int from, to;
            lines_of(p, top, from, to);
            float mx = 0, my = 0, mxx = 0, mxy = 0, myy = 0, mo = 0, mr = 0, mg = 0, mb = 0;
            for (int y = from; y < to; y++) {
                const float dy = top + y + 0.5f - p.y;
                float *clear = block.clear[y], *rest = behind[y];
                const float *r = by[0][y], *g = by[1][y], *b = by[2][y];
#pragma omp simd reduction(+ : mx, my, mxx, mxy, myy, mo, mr, mg, mb)
                for (int x = 0; x < TILE; x++) {
                    const float dx = left + x + 0.5f - p.x;
                    const float e = power(-0.5f * (p.a * dx * dx + p.c * dy * dy) - p.b * dx * dy);
                    const float raw = p.opacity * e;
                    float alpha = std::min(OPAQUE, raw);
                    alpha = alpha < FAINT || clear[x] < SPENT ? 0 : alpha;
                    const float weight = clear[x] * alpha;
                    const float value = r[x] * p.colour[0] + g[x] * p.colour[1] + b[x] * p.colour[2];
                    mr += weight * r[x], mg += weight * g[x], mb += weight * b[x];
                    rest[x] -= weight * value;
                    float change = clear[x] * value - rest[x] / (1 - alpha);
                    change = alpha > 0 && raw < OPAQUE ? change : 0;
                    clear[x] -= weight;
                    mo += change * e;
                    const float d = change * alpha;
                    mx += d * dx, my += d * dy, mxx += d * dx * dx, mxy += d * dx * dy, myy += d * dy * dy;
                }
            }
            const float out[MEASURED] = {p.a * mx + p.b * my, p.b * mx + p.c * my, -0.5f * mxx, -mxy, -0.5f * myy,
                                         mo, mr, mg, mb};
            std::copy(out, out + MEASURED, &by_pair[size_t(pair) * MEASURED]);
            if (++done % 32 == 0 && block.spent()) break;
        }
    }
}

// By the rotation's entries (3, 3) to by the quaternion that was normalised.
static void by_turn(const float* by, const Shape& s, float* out) {
    const float w = s.unit[0], x = s.unit[1], y = s.unit[2], z = s.unit[3];
    const float d[4] = {z * (by[3] - by[1]) + y * (by[2] - by[6]) + x * (by[7] - by[5]),
                        y * (by[1] + by[3]) + z * (by[2] + by[6]) + w * (by[7] - by[5]) - 2 * x * (by[4] + by[8]),
                        x * (by[1] + by[3]) + z * (by[5] + by[7]) + w * (by[2] - by[6]) - 2 * y * (by[0] + by[8]),
                        x * (by[2] + by[6]) + y * (by[5] + by[7]) + w * (by[3] - by[1]) - 2 * z * (by[0] + by[4])};
    const float along = d[0] * w + d[1] * x + d[2] * y + d[3] * z;
    for (int k = 0; k < 4; k++) out[k] = 2 * (d[k] - along * s.unit[k]) / s.length;
}

static void by_parameters(const Print& p, const Camera& c, int degree, const float* by, float* out) {
    const float* row = &rows[size_t(p.splat) * ROW];
    Shape s;
    shape_of(row, c, s);
    // of the conic Q = V^-1 to the print's covariance V: -Q G Q
    const float g0 = by[2], g1 = by[3] / 2, g2 = by[4];
    const float m00 = p.a * g0 + p.b * g1, m01 = p.a * g1 + p.b * g2, m10 = p.b * g0 + p.c * g1, m11 = p.b * g1 + p.c * g2;
    const float h00 = -(m00 * p.a + m01 * p.b), h01 = -(m00 * p.b + m01 * p.c), h11 = -(m10 * p.b + m11 * p.c);
    float widened[6], by_covariance[9], by_spread[6] = {};
    for (int k = 0; k < 3; k++) {
        widened[k] = h00 * s.spread[k] + h01 * s.spread[3 + k];
        widened[3 + k] = h01 * s.spread[k] + h11 * s.spread[3 + k];
    }
    for (int r = 0; r < 3; r++)
        for (int k = 0; k < 3; k++) {
            by_covariance[3 * r + k] = s.spread[r] * widened[k] + s.spread[3 + r] * widened[3 + k];
            by_spread[r] += 2 * widened[k] * s.covariance[3 * k + r];
            by_spread[3 + r] += 2 * widened[3 + k] * s.covariance[3 * k + r];
        }
    float x_ahead = 0, y_ahead = 0, x_wide = 0, y_wide = 0;  // by the entries of the projection's Jacobian
    for (int k = 0; k < 3; k++) {
        x_wide += by_spread[k] * c.turn[k], x_ahead += by_spread[k] * c.turn[6 + k];
        y_wide += by_spread[3 + k] * c.turn[3 + k], y_ahead += by_spread[3 + k] * c.turn[6 + k];
    }
    const float z = s.at[2], zz = z * z;
    float by_at[3] = {c.fx / z * by[0], c.fy / z * by[1], -(c.fx * s.at[0] * by[0] + c.fy * s.at[1] * by[1]) / zz};
    by_at[2] -= (c.fx * x_wide + c.fy * y_wide) / zz;
    if (!s.clamped[0]) by_at[0] -= c.fx / zz * x_ahead;
    if (!s.clamped[1]) by_at[1] -= c.fy / zz * y_ahead;
    by_at[2] += (s.clamped[0] ? 1 : 2) * c.fx * s.limited[0] / (zz * z) * x_ahead;
    by_at[2] += (s.clamped[1] ? 1 : 2) * c.fy * s.limited[1] / (zz * z) * y_ahead;
    float by_entries[9];
    for (int k = 0; k < 3; k++) {
        out[POSITION + k] = c.turn[k] * by_at[0] + c.turn[3 + k] * by_at[1] + c.turn[6 + k] * by_at[2];
        float scale = 0;
        for (int r = 0; r < 3; r++) {
            float axis = 0;
            for (int j = 0; j < 3; j++) axis += 2 * by_covariance[3 * r + j] * s.axes[3 * j + k];
            scale += axis * s.axes[3 * r + k];
            by_entries[3 * r + k] = axis * s.deviation[k];
        }
        out[SCALE + k] = scale;
    }
    by_turn(by_entries, s, out + TURN);
    out[OPACITY] = by[5] * p.opacity * (1 - p.opacity);
    float d[3], b[16];
    towards(row, c, d);  // how the colour changes with the place is left out: it is little
    harmonics(d, degree, b);
    for (int k = 0; k < 16; k++)
        for (int ch = 0; ch < 3; ch++) out[COLOUR + 3 * k + ch] = p.dark[ch] ? 0 : b[k] * by[6 + ch];
}

static void gather(const View& v, const Camera& camera, int degree, const Floats& by_pair) {
    std::fill(gradients.begin(), gradients.end(), 0.f);
#pragma omp parallel for schedule(static)
    for (int k = 0; k < int(v.prints.size()); k++) {
        const Print& p = v.prints[k];
        const int own = (p.x1 - p.x0) * (p.y1 - p.y0);
        float by[MEASURED] = {};
        for (int j = p.first; j < p.first + own; j++)
            for (int m = 0; m < MEASURED; m++) by[m] += by_pair[size_t(j) * MEASURED + m];
        place_gradients[p.splat] += std::hypot(by[0] * width / 2, by[1] * height / 2), place_counts[p.splat]++;
        by_parameters(p, camera, degree, by, &gradients[size_t(p.splat) * ROW]);
    }
}

// Eleven taps of deviation 1.5, zero beyond the edges: its own transpose.
static Floats blurred(const Floats& in) {
    static const Floats taps = [] {
        Floats made(11);
        float sum = 0;
        for (int k = 0; k < 11; k++) sum += made[k] = std::exp(-(k - 5) * (k - 5) / 4.5f);
        for (float& x : made) x /= sum;
        return made;
    }();
    Floats across(in.size(), 0.f), out(in.size(), 0.f);
#pragma omp parallel for
    for (int y = 0; y < height; y++)
        for (int k = 0; k < 11; k++)
            for (int x = std::max(0, 5 - k); x < std::min(width, width + 5 - k); x++)
                across[size_t(y) * width + x] += taps[k] * in[size_t(y) * width + x + k - 5];
#pragma omp parallel for
    for (int y = 0; y < height; y++)
        for (int k = std::max(0, 5 - y); k < std::min(11, height + 5 - y); k++)
            for (int x = 0; x < width; x++)
                out[size_t(y) * width + x] += taps[k] * across[size_t(y + k - 5) * width + x];
    return out;
}

static Floats product(const Floats& a, const Floats& b) {
    Floats out(a.size());
    for (size_t i = 0; i < a.size(); i++) out[i] = a[i] * b[i];
    return out;
}

// 0.8 L1 + 0.2 (1 - SSIM), means over pixels and channels, and its gradient by the view's pixels.
static double loss(const View& v, Picture& picture, Floats& by_pixel) {
    const size_t n = size_t(width) * height, plane = size_t(v.stride) * v.lines;
    const float share = 1.f / (3 * n), c1 = 1e-4f, c2 = 9e-4f;
    by_pixel.assign(3 * plane, 0.f);
    double l1 = 0, similar = 0;
    for (int c = 0; c < 3; c++) {
        Floats x(n), by_mean(n), by_square(n), by_product(n);
        const Floats y(picture.pixels.begin() + c * n, picture.pixels.begin() + (c + 1) * n);
        for (int r = 0; r < height; r++)
            std::copy_n(&v.image[c * plane + size_t(r) * v.stride], width, &x[size_t(r) * width]);
        if (picture.means[c].empty()) picture.means[c] = blurred(y), picture.squares[c] = blurred(product(y, y));
        const Floats mean = blurred(x), square = blurred(product(x, x)), both = blurred(product(x, y));
        for (size_t i = 0; i < n; i++) {
            const float mx = mean[i], my = picture.means[c][i];
            const float a1 = 2 * mx * my + c1, a2 = 2 * (both[i] - mx * my) + c2, b1 = mx * mx + my * my + c1;
            const float b2 = square[i] - mx * mx + picture.squares[c][i] - my * my + c2, s = a1 * a2 / (b1 * b2);
            similar += s;
            by_square[i] = -s / b2, by_product[i] = 2 * a1 / (b1 * b2);
            by_mean[i] = 2 * my * a2 / (b1 * b2) - 2 * mx * s / b1 - 2 * mx * by_square[i] - my * by_product[i];
        }
        const Floats m = blurred(by_mean), q = blurred(by_square), p = blurred(by_product);
        for (size_t i = 0; i < n; i++) {
            const float off = x[i] - y[i], sign = off > 0 ? 1.f : off < 0 ? -1.f : 0.f;
            l1 += std::fabs(off);
            by_pixel[c * plane + i / width * v.stride + i % width] =
                share * (0.8f * sign - 0.2f * (m[i] + 2 * x[i] * q[i] + y[i] * p[i]));
        }
    }
    return 0.8 * l1 * share + 0.2 * (1 - similar * share);
}

static float place_rate(float done) {
    return (going_on ? GOING_ON : 1) * extent * std::exp(std::log(2.4e-4f) * (1 - done) + std::log(2.4e-6f) * done);
}

static void step(int iteration, float done) {
    float rates[ROW];
    const float place = place_rate(done);
    std::fill(rates + POSITION, rates + SCALE, place), std::fill(rates + SCALE, rates + TURN, 7.5e-3f);
    std::fill(rates + TURN, rates + OPACITY, 1.5e-3f), rates[OPACITY] = 0.05f;
    std::fill(rates + COLOUR, rates + COLOUR + 3, 3.75e-3f), std::fill(rates + COLOUR + 3, rates + ROW, 1.9e-4f);
    if (flat) rates[SCALE + 2] = 0;
    const float first = 1 - std::pow(0.9f, iteration), second = 1 - std::pow(0.999f, iteration);
#pragma omp parallel for schedule(static)
    for (int i = 0; i < count(); i++)
        for (int k = 0; k < ROW; k++) {
            const size_t at = size_t(i) * ROW + k;
            const float g = gradients[at];
            momenta[at] = 0.9f * momenta[at] + 0.1f * g;
            variances[at] = 0.999f * variances[at] + 0.001f * g * g;
            rows[at] -= rates[k] / first * momenta[at] / (std::sqrt(variances[at] / second) + 1e-15f);
        }
}

// Opacity and width cost; the mean over all splats, as of the loss.
static void cost() {
    const float share = COST / count();
#pragma omp parallel for schedule(static)
    for (int i = 0; i < count(); i++) {
        float *row = &rows[size_t(i) * ROW], *by = &gradients[size_t(i) * ROW];
        const float opacity = sigmoid(row[OPACITY]);
        by[OPACITY] += share * opacity * (1 - opacity);
        for (int k = 0; k < 3; k++) by[SCALE + k] += share / 3 * std::exp(row[SCALE + k]) / extent;
    }
}

// Places walk by their own shape, squared as in the paper; the opaque ones hardly.
static void shake(float done, std::mt19937& random) {
    std::normal_distribution<float> normal;
    const float wide = SHAKE * place_rate(done) / (extent * extent);  // that world is as large as one unit
    for (int i = 0; i < count(); i++) {
        float *row = &rows[size_t(i) * ROW], q[4], length, turn[9], away[3], along[3] = {};
        unit_turn(row + TURN, q, length), rotation(q, turn);
        const float still = 1 / (1 + std::exp(-SHAKEN * (1 - sigmoid(row[OPACITY]) - UNSHAKEN)));
        for (float& x : away) x = normal(random);
        for (int k = 0; k < 3; k++) {
            for (int r = 0; r < 3; r++) along[k] += turn[3 * r + k] * away[r];
            along[k] *= std::exp(2 * row[SCALE + k]) * still * wide;
        }
        for (int r = 0; r < 3; r++)
            for (int k = 0; k < 3; k++) row[POSITION + r] += turn[3 * r + k] * along[k];
    }
}

// A splat's opacity and width where so many lie in its place and look as it did (equation 9 of the paper).
static void share_out(float* row, int many) {
    const double before = sigmoid(row[OPACITY]), now = 1 - std::pow(1 - before, 1.0 / many);
    double sum = 0;
    for (int i = 1; i <= many; i++) {
        double choose = 1;
        for (int k = 0; k < i; k++) {
            sum += choose * (k % 2 ? -1 : 1) * std::pow(now, k + 1) / std::sqrt(k + 1.0);
            choose *= double(i - 1 - k) / (k + 1);
        }
    }
    row[OPACITY] = logit(std::clamp(float(now), LEAST_OPACITY, 1 - 1e-6f));
    for (int k = 0; k < 3; k++) row[SCALE + k] += std::log(float(before / sum));
}

// The faint move to where others are opaque, and a few more come.
static void relocate(int most, std::mt19937& random) {
    constexpr int TOGETHER = 50;  // beyond, the sum of `share_out` is all rounding
    const int n = count();
    std::vector<int> faint;
    std::vector<double> opacity(n);
    for (int i = 0; i < n; i++) {
        opacity[i] = sigmoid(rows[size_t(i) * ROW + OPACITY]);
        if (opacity[i] <= LEAST_OPACITY) faint.push_back(i), opacity[i] = 0;
    }
    const int more = std::clamp(most - n, 0, int(MORE * n));
    for (int k = 0; k < more; k++) faint.push_back(n + k);
    for (Floats* all : {&rows, &momenta, &variances}) all->resize(size_t(n + more) * ROW, 0.f);
    gradients.assign(rows.size(), 0.f), place_gradients.assign(count(), 0.f), place_counts.assign(count(), 0);
    std::discrete_distribution<int> draw(opacity.begin(), opacity.end());
    std::vector<int> to(faint.size()), together(n, 1);
    for (int& i : to) {
        do i = draw(random);
        while (together[i] == TOGETHER);
        together[i]++;
    }
    for (int i = 0; i < n; i++)
        if (together[i] > 1) share_out(&rows[size_t(i) * ROW], together[i]);
    for (size_t k = 0; k < to.size(); k++) {
        std::copy_n(&rows[size_t(to[k]) * ROW], ROW, &rows[size_t(faint[k]) * ROW]);
        for (Floats* all : {&momenta, &variances})
            for (int i : {to[k], faint[k]}) std::fill_n(&(*all)[size_t(i) * ROW], ROW, 0.f);
    }
}

static float largest(int i) { return std::exp(*std::max_element(&rows[size_t(i) * ROW + SCALE], &rows[size_t(i) * ROW + TURN])); }

static void keep(const std::vector<char>& wanted) {
    size_t to = 0;
    for (int i = 0; i < count(); i++) {
        if (!wanted[i]) continue;
        for (Floats* all : {&rows, &momenta, &variances})
            std::copy_n(&(*all)[size_t(i) * ROW], ROW, &(*all)[to]);
        to += ROW;
    }
    for (Floats* all : {&rows, &momenta, &variances}) all->resize(to);
    gradients.assign(to, 0.f), place_gradients.assign(to / ROW, 0.f), place_counts.assign(to / ROW, 0);
}

static void split(int i, std::mt19937& random) {
    float q[4], length, turn[9];
    unit_turn(&rows[size_t(i) * ROW + TURN], q, length);
    rotation(q, turn);
    std::normal_distribution<float> normal;
    for (int half = 0; half < 2; half++) {
        Floats row(rows.begin() + size_t(i) * ROW, rows.begin() + size_t(i + 1) * ROW);
        for (int k = 0; k < 3; k++) {
            const float away = normal(random) * std::exp(row[SCALE + k]);
            for (int r = 0; r < 3; r++) row[POSITION + r] += turn[3 * r + k] * away;
        }
        for (int k = 0; k < 3; k++) row[SCALE + k] -= std::log(1.6f);
        rows.insert(rows.end(), row.begin(), row.end());
    }
}

// More splats where places pull most; none that is faint or, once opacities were reset, as wide as the scene.
static void densify(int most, bool prune_large, std::mt19937& random) {
    const int n = count();
    std::vector<int> pulled;
    Floats pull(n, 0.f);
    for (int i = 0; i < n; i++) {
        if (place_counts[i]) pull[i] = place_gradients[i] / place_counts[i];
        if (pull[i] > WANTED) pulled.push_back(i);
    }
    std::stable_sort(pulled.begin(), pulled.end(), [&](int a, int b) { return pull[a] > pull[b]; });
    pulled.resize(std::min<size_t>(pulled.size(), std::max(0, most - n)));
    std::vector<char> wanted(n, 1);
    for (int i : pulled) {
        if (largest(i) > SMALL * extent) {
            split(i, random), wanted[i] = 0;
        } else {
            const Floats row(rows.begin() + size_t(i) * ROW, rows.begin() + size_t(i + 1) * ROW);
            rows.insert(rows.end(), row.begin(), row.end());
        }
    }
    momenta.resize(rows.size(), 0.f), variances.resize(rows.size(), 0.f), wanted.resize(count(), 1);
    for (int i = 0; i < count(); i++) {
        if (sigmoid(rows[size_t(i) * ROW + OPACITY]) < LEAST_OPACITY) wanted[i] = 0;
        if (prune_large && largest(i) > LARGE * extent) wanted[i] = 0;
    }
    keep(wanted);
}

static void reset_opacities() {
    for (int i = 0; i < count(); i++) {
        const size_t at = size_t(i) * ROW + OPACITY;
        rows[at] = std::min(rows[at], logit(RESET));
        momenta[at] = variances[at] = 0;
    }
}

static void read(void* to, size_t numbers, FILE* file) {
    if (std::fread(to, 4, numbers, file) != numbers) std::fputs("the data end too early\n", stderr), std::exit(1);
}

// Width, height, pictures, points (int32); extent; each picture's camera and planes; each point's place, size, colour.
static std::vector<Picture> load(const char* path) {
    FILE* file = std::fopen(path, "rb");
    if (!file) std::perror(path), std::exit(1);
    int32_t sizes[4];
    read(sizes, 4, file), read(&extent, 1, file);
    width = sizes[0], height = sizes[1];
    tiles_x = (width + TILE - 1) / TILE, tiles_y = (height + TILE - 1) / TILE;
    std::vector<Picture> pictures(sizes[2]);
    for (Picture& picture : pictures) {
        picture.pixels.resize(size_t(3) * width * height);
        read(&picture.camera, sizeof(Camera) / 4, file), read(picture.pixels.data(), picture.pixels.size(), file);
    }
    rows.assign(size_t(sizes[3]) * ROW, 0.f);
    std::mt19937 random(3);
    std::normal_distribution<float> normal;
    for (int i = 0; i < sizes[3]; i++) {
        float point[7], *row = &rows[size_t(i) * ROW];
        read(point, 7, file);
        for (int k = 0; k < 3; k++) {
            row[POSITION + k] = point[k], row[SCALE + k] = std::log(point[3]);
            row[COLOUR + k] = (point[4 + k] - 0.5f) / HARMONIC;
        }
        row[TURN] = 1, row[OPACITY] = logit(moved ? 0.5f : 0.1f);
        if (flat) {
            for (int k = 0; k < 4; k++) row[TURN + k] = normal(random);
            row[SCALE + 2] = std::log(FLAT * extent);
        }
    }
    std::fclose(file);
    momenta.assign(rows.size(), 0.f), variances = momenta, gradients = momenta;
    place_gradients.assign(sizes[3], 0.f), place_counts.assign(sizes[3], 0);
    return pictures;
}

static void go_on_from(const char* path) {
    FILE* file = std::fopen(path, "rb");
    if (!file || std::fseek(file, 0, SEEK_END)) std::perror(path), std::exit(1);
    rows.resize(std::ftell(file) / (4 * ROW) * ROW);
    std::rewind(file), read(rows.data(), rows.size(), file), std::fclose(file);
    momenta.assign(rows.size(), 0.f), variances = momenta, gradients = momenta;
    place_gradients.assign(count(), 0.f), place_counts.assign(count(), 0);
    going_on = true;
}

static void train(std::vector<Picture>& pictures, int iterations, int most) {
    std::mt19937 random(1);
    std::vector<int> order;
    View view;
    Floats by_pixel, by_pair;
    double smooth = 0;
    const int reset = std::max(1, iterations / 4), grown = iterations * 55 / 100;
    for (int i = 1; i <= iterations; i++) {
        if (order.empty()) {
            order.resize(pictures.size());
            std::iota(order.begin(), order.end(), 0);
            std::shuffle(order.begin(), order.end(), random);
        }
        Picture& picture = pictures[order.back()];
        order.pop_back();
        const int degree = std::min(highest, 10 * (i - 1) / iterations);
        view.look(picture.camera, degree);
        blend(view);
        const double now = loss(view, picture, by_pixel);
        smooth = i == 1 ? now : 0.98 * smooth + 0.02 * now;
        unblend(view, by_pixel, by_pair);
        gather(view, picture.camera, degree, by_pair);
        if (moved) cost();
        step(i, float(i) / iterations);
        if (moved) {
            shake(float(i) / iterations, random);
            if (i % 50 == 0 && i >= iterations / 20 && i < iterations * 85 / 100) relocate(most, random);
        } else if (i % 100 == 0 && i >= iterations / 10 && i < grown) densify(most, i > reset, random);
        if (i % reset == 0 && i < grown && !going_on && !moved) reset_opacities();
        if (i % 100 == 0) std::printf("%d %.4f %d\n", i, smooth, count()), std::fflush(stdout);
    }
}

int main(int given, char** arguments) {
    moved = std::strcmp(arguments[5], "moved") == 0, flat = std::strcmp(arguments[5], "flat") == 0;
    std::vector<Picture> pictures = load(arguments[1]);
    if (given > 7) highest = std::atoi(arguments[6]), go_on_from(arguments[7]);
    train(pictures, std::atoi(arguments[3]), std::atoi(arguments[4]));
    std::vector<char> wanted(count());
    for (int i = 0; i < count(); i++) {
        const float* row = &rows[size_t(i) * ROW];
        const bool finite = std::all_of(row, row + ROW, [](float x) { return std::isfinite(x); });
        wanted[i] = finite && sigmoid(row[OPACITY]) >= LEAST_OPACITY;
    }
    keep(wanted);
    FILE* file = std::fopen(arguments[2], "wb");
    if (!file || std::fwrite(rows.data(), 4, rows.size(), file) != rows.size()) std::perror(arguments[2]), std::exit(1);
    std::fclose(file);
}
