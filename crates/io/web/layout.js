// How the scene lies in textures: what worker, page and project.frag agree on.

/** Width of all textures, texels; every WebGL2 device has this. */
export const TEXTURE_WIDTH = 2048;
/** Texels of a Gaussian's geometry: mean and logit; quaternion; logarithms of standard deviations. */
export const GEOMETRY_TEXELS = 3;
/** Texels of a row: world (3), colour matrix (3), tint, and indices. */
export const ROW_TEXELS = 8;
