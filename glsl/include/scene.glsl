// The scene in the layout of the kernels: source Gaussians, instances, chunks, and the view.

// What an instance shows of one range of source Gaussians: its template, its own Gaussians (with rows of the same instance
// side by side), or a level of detail.
struct Instance {
    vec4 world_from_template[3];  // rows of the 3x4 similarity
    vec3 bound_center;            // centre of the sphere around the means, template frame
    float bound_radius;           // radius of that sphere, template units
    float sigma_max;              // largest standard deviation of the Gaussians, template units
    float max_offset;             // largest length of the instance's mean offsets, template units
    float sigma_growth;           // largest factor by which the instance's offsets enlarge a standard deviation, at least 1
    float scale;                  // uniform scale of world_from_template
    uint first_source;            // index of the first Gaussian in the source pool
    uint source_count;            // number of Gaussians
    uint first_offset;            // first offset record, NO_OFFSET if none
    uint first_chunk;             // index of the first chunk
    uint sh_degree;               // SH degree of the Gaussians; higher bands have no elements for them
    uvec3 first_in_band;          // index of the first Gaussian in SH bands 1, 2, 3
    float cell;                   // side of the cells that were merged to this level, template units; 0 = full detail
    float next_cell;              // cell of the next coarser level, 1e30 if there is none
    uint owner;                   // index of the instance in the scene; the number of instances for the background
    uint color;                   // index of its colour matrix, NO_COLOR if it has none
    uint local_before;            // number of the instance's Gaussians in rows before this one
};

struct Chunk {
    vec3 center;      // centre of the sphere around the chunk's means, template frame
    float radius;     // radius of that sphere, template units
    float sigma_max;  // largest standard deviation in the chunk, template units
};

struct WorkItem {
    uint instance;  // index into instances
    uint chunk;     // chunk within the instance's template
};

struct View {
    vec4 view_from_world[3];  // rows of the rigid transform, OpenCV axes
    vec3 position_world;      // camera centre
    float near;               // splats with view depth <= near are not drawn
    vec2 focal_px;            // focal lengths in pixels
    vec2 principal_px;        // principal point in pixels
    uvec2 size_px;            // image width and height
    float dilation_px2;       // added to the projected variances (0.3)
    uint antialias;           // 1 = opacity compensation for the dilation
};

vec3 transform_point(vec4 rows[3], vec3 p) {
    return vec3(dot(rows[0].xyz, p) + rows[0].w, dot(rows[1].xyz, p) + rows[1].w, dot(rows[2].xyz, p) + rows[2].w);
}

mat3 linear_part(vec4 rows[3]) {
    return transpose(mat3(rows[0].xyz, rows[1].xyz, rows[2].xyz));
}

// Limit of x/z and y/z in the Jacobian beyond the image: 15 % of the image on each side.
vec2 limit_min(View view) {
    return -(view.principal_px + 0.15 * vec2(view.size_px)) / view.focal_px;
}

vec2 limit_max(View view) {
    return (1.15 * vec2(view.size_px) - view.principal_px) / view.focal_px;
}

// sqrt(2 ln 255) = 3.3290, where the alpha of an opaque splat falls to 1/255. Rounded up for f32.
const float EXTENT_SIGMAS = 3.34;

// Transforms are validated to be rigid, or a rotation times a scale, within 1e-3 of A^T A: lengths may grow by half of
// that and, because the scale is taken from the determinant, by as much again. Doubled for safety.
const float LENGTH_SLACK = 1.002;

// Rounding error of a transformed point: a few ulps (6e-8) of the terms before they cancel, for the centre and for a
// mean in the ball, whose terms the radius covers.
float rounding_of(vec4 rows[3], vec3 p) {
    vec3 terms = vec3(dot(abs(rows[0].xyz), abs(p)) + abs(rows[0].w), dot(abs(rows[1].xyz), abs(p)) + abs(rows[1].w),
                      dot(abs(rows[2].xyz), abs(p)) + abs(rows[2].w));
    return 2e-6 * (terms.x + terms.y + terms.z);
}

// Where the splats of a ball of Gaussians may be, in the view's frame.
struct Reach {
    vec3 center;   // centre of the ball around their means
    float radius;  // its radius, rounding included
    vec2 reach;    // pixels times depth that the largest splat extends at most, dilation apart
    float border;  // pixels that dilation adds to that, and one more
};

// The reach of Gaussians whose means lie within `radius` of `center` in the frame of `world_from_local` and whose largest
// standard deviation is `sigma`; `scale` is that of the transform. A splat at view (x, y, z) reaches
// |du| <= EXTENT_SIGMAS sqrt((f/z)^2 (1 + lim^2) sigma^2 + dilation) pixels, which is at most f L sigma k / z + k sqrt(dilation)
// with L = sqrt(1 + lim^2).
Reach reach_of_ball(View view, vec4 world_from_local[3], float scale, vec3 center, float radius, float sigma) {
    vec3 center_world = transform_point(world_from_local, center);
    Reach r;
    r.center = transform_point(view.view_from_world, center_world);
    r.radius = scale * radius * LENGTH_SLACK * LENGTH_SLACK + rounding_of(world_from_local, center) +
               rounding_of(view.view_from_world, center_world);
    vec2 limit = max(abs(limit_min(view)), abs(limit_max(view)));
    float sigma_view = scale * sigma * LENGTH_SLACK * LENGTH_SLACK;
    r.reach = EXTENT_SIGMAS * sigma_view * view.focal_px * sqrt(1.0 + limit * limit);
    r.border = EXTENT_SIGMAS * sqrt(view.dilation_px2) + 1.0;
    return r;
}

// True if no splat of the ball can touch the image: "u + du >= 0" times z is linear in x and z, so over a ball it is a
// half-space test. NaN never culls.
bool outside_view(View view, Reach r) {
    vec3 c = r.center;
    if (c.z + r.radius < view.near) return true;
    vec2 low = view.principal_px + r.border;                        // u >= -border
    vec2 high = vec2(view.size_px) - view.principal_px + r.border;  // u <= width + border
    vec2 distance_low = view.focal_px * c.xy + low * c.z + r.radius * sqrt(view.focal_px * view.focal_px + low * low) + r.reach;
    vec2 distance_high = -view.focal_px * c.xy + high * c.z + r.radius * sqrt(view.focal_px * view.focal_px + high * high) + r.reach;
    return distance_low.x < 0.0 || distance_low.y < 0.0 || distance_high.x < 0.0 || distance_high.y < 0.0;
}
