// What the children of a split Gaussian are like beside their parent.

// Where child number `child` lies from its parent's centre, in standard deviations along the parent's axes: with `halves` so far
// along the longest axis, the even ones ahead, else drawn at random. `log_scales` and `index` are the parent's.
vec3 child_place(bool halves, float distance, vec3 log_scales, uvec2 seed, uint time, uint index, uint child) {
    if (!halves) return random_normals(seed, time, RANDOM_SPLIT, index, child);
    vec3 place = vec3(0.0);
    place[longest_axis(log_scales)] = child % 2 == 0 ? distance : -distance;
    return place;
}

// exp of its negative is finite.
const float LOGIT_LEAST = -80.0;

// Opacity logit of a child whose opacity is its parent's times `opacity`, which is at most 1: that of opacity / (1 + exp(-logit)),
// without the difference from 1 of what is nearly 1.
float child_logit(float logit, float opacity) {
    return opacity < 1.0 ? log(opacity) - log(exp(-max(logit, LOGIT_LEAST)) + 1.0 - opacity) : logit;
}
