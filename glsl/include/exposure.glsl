// The exposure of a photo: an affine map of the scene's colours to the photo's, M rgb + b, as three rows (M_r, b_r) of
// each training view.

const uint EXPOSURE_ROWS = 3;     // rows of an exposure, one for each channel of the photo
const uint EXPOSURE_VALUES = 12;  // numbers of an exposure, row by row
const uint EXPOSURE_PIXELS = 8;   // pixels that one thread of `exposure_backward` sums
