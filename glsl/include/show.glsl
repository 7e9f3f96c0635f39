// What a window shows of a picture.

const uint SHOW_COLOR = 0;      // colour over the background
const uint SHOW_ALPHA = 1;      // grey: 1 - T
const uint SHOW_DEPTH = 2;      // grey: white at the near end of the range, black at the far end and where nothing is
const uint SHOW_INSTANCES = 3;  // a colour for each instance, black where there is none
