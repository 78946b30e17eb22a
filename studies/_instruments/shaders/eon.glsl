#version 330

// Portsmouth, Kutz and Hill 2025: energy-preserving Oren-Nayar, with their rational approximation of the albedo.

const float PI = 3.14159265358979323846;
const float A1 = 0.5 - 2.0 / (3.0 * PI);
const float A2 = 2.0 / 3.0 - 28.0 / (15.0 * PI);

uniform vec3 rho = vec3(1.0);
uniform float roughness = 1.0;

// the directional albedo of the single-scattering lobe
float single(float mu, float r)
{
    const float g[4] = float[4](0.0571085289, 0.491881867, -0.332181442, 0.0714429953);
    float u = 1.0 - mu, power = 1.0, sum = 0.0;
    for (int i = 0; i < g.length(); i++) {
        power *= u;
        sum += g[i] * power;
    }
    return (1.0 + r * sum) / (1.0 + A1 * r);
}

vec3 eon(vec3 L, vec3 V, vec3 N)
{
    float nl = dot(N, L), nv = dot(N, V);
    if (nl <= 0.0 || nv <= 0.0)
        return vec3(0.0);
    float s = dot(L, V) - nl * nv;
    float share = s > 0.0 ? s / max(nl, nv) : s;
    float scale = 1.0 / (1.0 + A1 * roughness);
    vec3 one = rho / PI * scale * (1.0 + roughness * share);
    float lost = 1e-7;
    float el = single(nl, roughness), ev = single(nv, roughness);
    float mean = scale * (1.0 + A2 * roughness);
    vec3 again = rho * rho * mean / (vec3(1.0) - rho * (1.0 - mean));
    return one + again / PI * max(lost, 1.0 - el) * max(lost, 1.0 - ev) / max(lost, 1.0 - mean);
}
