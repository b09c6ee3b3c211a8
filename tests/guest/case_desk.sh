#!/usr/bin/dash
# For other scripts, in the guest and out of it: the head of a room file, a desk with one screen. What is on it follows.
cat <<'END'
room: guest
neutral_m: [0, 1.2, 0.65]
nodes: [{id: desk}]
walls:
  - id: screen
    corners_m: {lower_left: [-0.299, 1.0, 0], lower_right: [0.299, 1.0, 0], upper_left: [-0.299, 1.336, 0]}
    pixels: [320, 180]
    display: {kind: lcd, refresh_hz: 60}
END
