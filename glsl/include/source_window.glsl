// Windows of the source Gaussians, for scenes whose arrays are larger than a binding: each dispatch sees the rows of one.
layout(constant_id = 13) const uint WINDOWED = 0;  // 1 = bindings hold the rows of a window

// Source Gaussians of which a dispatch sees the rows.
struct SourceWindow {
    uint first;           // the first source Gaussian
    uint count;           // number of Gaussians at which its chunks may begin
    uvec3 first_in_band;  // first row of the bindings of SH bands 1, 2, 3
};

// True if the chunk that begins with `source` is the window's.
bool in_window(SourceWindow window, uint source) {
    return WINDOWED == 0 || source - window.first < window.count;
}
