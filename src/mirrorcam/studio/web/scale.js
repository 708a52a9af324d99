"use strict";
// Things of known size beside the device: a ruler, a cup and a hand. Points are in the axes of three.js, mm, y up.
(() => {
  const RULER_MM = 200;
  const CUP_MM = { radius: 40, height: 95, handle: 28 };
  // The outline of a left hand, palm to the viewer: 84 mm across the palm and 190 mm long (means of adults).
  const HAND_MM = [
    [-30, 0], [-33, 40], [-42, 70], [-44, 118], [-42, 147], [-36, 153], [-30, 147], [-27, 105], [-24, 100], [-22, 165], [-18, 178], [-11, 178],
    [-7, 165], [-6, 104], [-3, 104], [-2, 175], [2, 189], [9, 190], [13, 176], [14, 104], [17, 102], [20, 160], [25, 169],
    [31, 167], [34, 155], [32, 98], [34, 70], [52, 95], [60, 108], [68, 106], [68, 97], [50, 50], [32, 18], [30, 0],
  ];

  const ring = (count, point) => Array.from({ length: count }, (_, i) => point((2 * Math.PI * i) / count));
  const joined = (points, isClosed = true) => points.flatMap((point, i, all) => (i + 1 < all.length || isClosed ? [point, all[(i + 1) % all.length]] : []));

  // Segments of a ruler along x: a tick each 10 mm, longer each 50 mm.
  const ruler = ([x, y, z]) => {
    const ticks = Array.from({ length: RULER_MM / 10 + 1 }, (_, i) => [[x + 10 * i, y, z], [x + 10 * i, y + (i % 5 ? 4 : 9), z]]);
    return [[x, y, z], [x + RULER_MM, y, z], ...ticks.flat()];
  };

  const cup = ([x, y, z]) => {
    const { radius, height, handle } = CUP_MM;
    const circle = (level, size) => joined(ring(32, (angle) => [x + size * Math.cos(angle), y + level, z + size * Math.sin(angle)]));
    const sides = ring(8, (angle) => [[x + 0.8 * radius * Math.cos(angle), y, z + 0.8 * radius * Math.sin(angle)], [x + radius * Math.cos(angle), y + height, z + radius * Math.sin(angle)]]);
    const grip = Array.from({ length: 13 }, (_, i) => [x + 0.92 * radius + handle * Math.sin((Math.PI * i) / 12), y + height * (0.5 - 0.32 * Math.cos((Math.PI * i) / 12)), z]);
    return [...circle(0, 0.8 * radius), ...circle(height, radius), ...sides.flat(), ...joined(grip, false)];
  };

  const hand = ([x, y, z]) => joined(HAND_MM.map(([right, up]) => [x + right, y + up, z]));

  // Segments of all three, on a table at the height `floor`, to the left and right of x = 0.
  Studio.scaleSegments = (floor, aside) => [...ruler([-RULER_MM / 2, floor, 40]), ...cup([-aside - 30, floor, -40]), ...hand([aside + 30, floor, 40])];
})();
