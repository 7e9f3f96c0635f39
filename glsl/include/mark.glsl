// Shapes and shading of the marks on single splats.

const uint MARK_POINTS = 0;    // a disc around the centre
const uint MARK_ELLIPSES = 1;  // the ellipse of one standard deviation

// Radius of a point's disc, pixels.
const float POINT_RADIUS_PX = 1.5;
// Share of the colour at the rim of a mark: it falls with the square of the distance from the centre.
const float RIM = 0.35;
