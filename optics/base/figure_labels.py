"""What each figure is called where people read it, on pages and in a terminal alike: the one table of labels.

Keys are names of metrics without what they are of ("mount.") and without a depth ("_300mm"); files keep the names.
Labels of a device are read after that ("Mirrors: without a seat"), and with it fit a terminal of 80 columns.
Names whose words say enough ("grid_error", "pixel_efficiency") need no label.
"""

from __future__ import annotations

from collections.abc import Mapping

ASSEMBLY: Mapping[str, str] = {
    "pieces_amiss": "pieces missing or unexpected",
    "parts_sliced": "parts checked with a slicer",
    "meshes_broken": "meshes that enclose no solid",
    "mass_g": "mass, plastic as solid",
    "centre_x_mm": "centre of mass, x",
    "centre_y_mm": "centre of mass, y",
    "centre_z_mm": "centre of mass, z",
    "tilt_deg": "tilt of the mirrors under gravity",
    "shift_um": "shift of the mirrors under gravity",
    "clash_mm3": "interference volume",
    "clearance_mm": "smallest clearance",
    "mirrors_off_their_seats": "mirrors off their seats",
    "fasteners_loose": "fasteners that hold nothing",
    "screws_without_thread": "screws that engage no thread",
}

LIGHT: Mapping[str, str] = {
    "rays_cast": "light rays cast",
    "rays_blocked": "light rays blocked",
    "mirrors_without_light": "mirrors without usable area",
    "rim_light_stopped": "light blocked at pupil's rim",
    "shade_of_sheets": "light blocked by mirrors",
    "stray_light": "pixels with stray light",
    "light_gap_mm": "smallest gap to the light",
}

MIRRORS: Mapping[str, str] = {
    "outlines_missing": "missing from the cut files",
    "outlines_too_many": "outlines of unknown mirrors",
    "stray_cuts": "cut lines of no mirror",
    "names_twice": "drawn more than once",
    "files_not_in_mm": "cut files not in millimetres",
    "outline_error_um": "largest outline error",
    "outline_gap_mm": "smallest gap of outlines",
    "outlines_off_sheet": "outlines beyond the sheet",
    "marks_missing": "without an engraved mark",
    "marks_off_mirror": "engraved lines off a mirror",
    "arrow_error_deg": "largest arrow error",
    "seats_missing": "without a seat",
    "seat_offset_um": "largest seat offset",
    "seat_angle_deg": "largest seat tilt",
    "seat_cover": "smallest share on its seat",
    "seat_cover_lost": "seat share lost against plan",
    "seat_span_mm": "largest unsupported span",
    "pocket_walls": "pocket walls found",
    "pocket_error_um": "largest pocket wall error",
    "drop_clash_mm3": "obstruction when inserted",
    "room_clash_mm3": "obstruction of the clearance",
    "room_mm": "clearance all round",
    "sheets": "stock sheets",
    "sheet_use": "share of stock sheets used",
    "feature_of_thickness": "smallest width / thickness",
    "line_gap_mm": "smallest gap of laser lines",
}

PRINTED_PARTS: Mapping[str, str] = {
    "solids": "solids in the STEP file",
    "invalid_solids": "invalid solids in the STEP file",
    "volume_cm3": "volume",
    "mesh_watertight": "mesh is watertight (1: yes)",
    "mesh_manifold": "mesh is manifold (1: yes)",
    "mesh_pieces": "connected pieces of the mesh",
    "mesh_triangles": "triangles of the mesh",
    "stl_volume_error_mm3": "volume error of the STL file",
    "3mf_volume_error_mm3": "volume error of the 3MF file",
    "wall_mm": "thinnest wall",
    "print_length_mm": "length on the bed",
    "print_width_mm": "width on the bed",
    "print_height_mm": "height on the bed",
    "off_bed_um": "extent beyond the bed",
    "above_bed_um": "gap between part and bed",
    "lie_error_um": "print orientation error",
    "overhang_mm2": "overhangs that need support",
    "bridged_mm2": "bridged area",
    "longest_bridge_mm": "longest bridge",
    "floating_mm2": "largest area that starts in mid-air",
    "slices": "slicer accepts the 3MF file (1: yes)",
    "print_minutes": "printing time",
    "print_g": "mass as sliced",
    "support_filament_mm": "filament used for support, length",
}

DESIGNS: Mapping[str, str] = {
    "depth_nearest_mm": "nearest depth",
    "depth_farthest_mm": "farthest depth",
    "depth_resolution_fine": "fine depth resolution",
    "disparity_s": "disparity along s",
    "disparity_t": "disparity along t",
    "unlike_spec": "differences from request",
    "outside_sensor_px": "sub-images beyond sensor",
    "shortest_edge_mm": "shortest edge of a mirror",
    "longest_edge_mm": "longest edge of a mirror",
    "smallest_area_mm2": "area of the smallest mirror",
    "largest_area_mm2": "area of the largest mirror",
    "smallest_gap_mm": "gap between mirrors",
    "smallest_seen_gap_mm": "gap between sub-images",
    "beyond_depth_mm": "mirrors past nearest depth",
    "common_area": "area in all views",
    "blocked_light": "light lost to other mirrors",
}

CALIBRATIONS: Mapping[str, str] = {
    "rms_x_px": "reprojection error, RMS in x",
    "rms_y_px": "reprojection error, RMS in y",
    "direct_rms_x_px": "reprojection error without mirrors, RMS in x",
    "direct_rms_y_px": "reprojection error without mirrors, RMS in y",
    "spatial_rms_mm": "distance of corners from their viewing rays, RMS",
    "corners": "corners used",
    "outliers": "corners left out as outliers",
    "held_out_outliers": "corners left out as outliers, held-out frames",
    "sigma_px": "noise of a corner, per axis",
    "iterations": "iterations of the solver",
    "common_turn_sigma_deg": "rotation of all mirrors together, \N{GREEK SMALL LETTER SIGMA}",
    "common_shift_sigma_mm": "shift of all mirrors together, \N{GREEK SMALL LETTER SIGMA}",
    "mirror_to_mirror_normal_sigma_deg": "mirror normals to each other, largest \N{GREEK SMALL LETTER SIGMA}",
    "mirror_to_mirror_distance_sigma_mm": "mirror distances to each other, largest \N{GREEK SMALL LETTER SIGMA}",
    "projection_sigma_px": "projected point, \N{GREEK SMALL LETTER SIGMA}",
    "projection_against_reference_sigma_px": "projected point against the reference view, \N{GREEK SMALL LETTER SIGMA}",
    "uncertainty_widened": "factor by which tests increase every \N{GREEK SMALL LETTER SIGMA}",
    "alarms": "alarms: the model contradicts the pictures",
    "depth_matching_sigma_mm": "depth at working range, \N{GREEK SMALL LETTER SIGMA} of matching",
    "depth_calibration_sigma_mm": "depth at working range, \N{GREEK SMALL LETTER SIGMA} of calibration",
    "unexplained_px": "error that flat mirrors leave unexplained",
    "split_halves_ratio": "similar halves: difference / predicted",
    "split_near_ratio": "near and far boards: difference / predicted",
    "damaged_pictures": "damaged pictures, not used",
    "flat_board_rms_x_px": "reprojection error of a flat board, RMS in x",
    "flat_board_rms_y_px": "reprojection error of a flat board, RMS in y",
    "camera_turned_px": "largest rotation of the camera between pictures",
    "aperture_mm": "diameter of the lens's pupil",
    "aperture_sigma_mm": "diameter of the lens's pupil, \N{GREEK SMALL LETTER SIGMA}",
    "focus_mm": "distance in focus",
    "focus_sigma_per_m": "one over the distance in focus, \N{GREEK SMALL LETTER SIGMA}",
    "sheet_mm": "thickness of the mirrors",
    "sheet_sigma_mm": "thickness of the mirrors, \N{GREEK SMALL LETTER SIGMA}",
    "views": "views that show corners",
    "board_shift_in_plane_rms_mm": "errors of the board in its plane, RMS",
    "board_warp_rms_mm": "errors of the board out of its plane, RMS",
}

VALIDATIONS: Mapping[str, str] = {
    "normal_error_rms_deg": "mirror normals, against the ground truth, RMS",
    "distance_error_rms_mm": "mirror distances, against the ground truth, RMS",
    "focal_error_px": "focal length, against the ground truth",
    "decoded_corner_p95_px": "corners in decoded views, 95 % quantile",
    "decoded_corners": "corners found in decoded views",
    "normal_error_max_deg": "worst mirror normal, against the ground truth",
    "normal_error_between_mirrors_max_deg": "worst mirror normal, without the rotation common to all mirrors",
    "distance_error_max_mm": "worst mirror distance, against the ground truth",
    "held_out_rms_x_px": "reprojection error of held-out frames, RMS in x",
    "held_out_rms_y_px": "reprojection error of held-out frames, RMS in y",
    "held_out_spatial_rms_mm": "distance of held-out corners from their viewing rays, RMS",
    "decoded_corner_rms_px": "corners in decoded views, against a pinhole at the true position, RMS",
}

LABELS: Mapping[str, str] = {**ASSEMBLY, **LIGHT, **MIRRORS, **PRINTED_PARTS, **DESIGNS, **CALIBRATIONS, **VALIDATIONS}
