"""What each figure is called where people read it, on pages and in a terminal alike: the one table of labels.

Keys are names of metrics without what they are of ("mount.") and without a depth ("_300mm"); files keep the names.
Names whose words say enough ("grid_error", "pixel_efficiency") need no label.
"""

from __future__ import annotations

from collections.abc import Mapping

ASSEMBLY: Mapping[str, str] = {
    "pieces_amiss": "pieces missing or unexpected",
    "parts_sliced": "parts checked with a slicer",
    "meshes_broken": "meshes that enclose no solid",
    "mass_g": "mass",
    "centre_x_mm": "centre of mass, x",
    "centre_y_mm": "centre of mass, y",
    "centre_z_mm": "centre of mass, z",
    "tilt_deg": "tilt of the mirrors under gravity",
    "shift_um": "shift of the mirrors under gravity",
    "clash_mm3": "interference volume",
    "clearance_mm": "smallest clearance between pieces",
    "mirrors_off_their_seats": "mirrors that do not touch their seats",
    "fasteners_loose": "fasteners that hold nothing",
    "screws_without_thread": "screws that engage no thread",
}

LIGHT: Mapping[str, str] = {
    "rays_cast": "light rays cast",
    "rays_blocked": "light rays blocked",
    "mirrors_without_light": "mirrors without a usable area",
    "rim_light_stopped": "share of light blocked at the pupil's rim",
    "shade_of_sheets": "light of one mirror blocked by others",
    "stray_light": "stray light: pixels that see past the parts",
    "light_gap_mm": "smallest gap to the light",
}

MIRRORS: Mapping[str, str] = {
    "outlines_missing": "mirrors missing from the cut files",
    "outlines_too_many": "outlines of unknown mirrors",
    "stray_cuts": "cut lines that belong to no mirror",
    "names_twice": "mirrors drawn more than once",
    "files_not_in_mm": "cut files not in millimetres",
    "outline_error_um": "largest error of an outline, less the kerf",
    "outline_gap_mm": "smallest gap between outlines",
    "outlines_off_sheet": "outlines beyond the stock sheet",
    "marks_missing": "mirrors without an engraved mark",
    "marks_off_mirror": "engraved lines beyond their mirror",
    "arrow_error_deg": "largest error of an engraved arrow",
    "seats_missing": "mirrors without a seat",
    "seat_offset_um": "largest offset of a seat from its mirror",
    "seat_angle_deg": "largest tilt of a seat from its mirror",
    "seat_cover": "smallest share of a mirror on its seat",
    "seat_cover_lost": "share of a seat lost against its plan",
    "seat_span_mm": "largest unsupported span behind a mirror",
    "pocket_walls": "pocket walls found",
    "pocket_error_um": "largest error of a pocket wall",
    "drop_clash_mm3": "material in the way of inserting a mirror",
    "room_clash_mm3": "material in the clearance round a mirror",
    "room_mm": "clearance round a mirror",
    "sheets": "stock sheets",
    "sheet_use": "share of the stock sheets that is used",
    "feature_of_thickness": "narrowest mirror, width over thickness",
    "line_gap_mm": "smallest gap between laser lines",
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
    "print_g": "filament used, mass",
    "support_filament_mm": "filament used for support, length",
}

DESIGNS: Mapping[str, str] = {
    "unlike_spec": "properties that differ from the request",
    "outside_sensor_px": "extent of sub-images beyond the sensor",
    "shortest_edge_mm": "shortest edge of a mirror",
    "longest_edge_mm": "longest edge of a mirror",
    "smallest_area_mm2": "area of the smallest mirror",
    "largest_area_mm2": "area of the largest mirror",
    "smallest_gap_mm": "smallest gap between mirrors",
    "smallest_seen_gap_mm": "smallest gap between sub-images",
    "beyond_depth_mm": "extent of mirrors past the nearest depth",
    "common_area": "area seen by all views",
    "blocked_light": "light of one mirror blocked by another",
}

VALIDATIONS: Mapping[str, str] = {
    "normal_error_max_deg": "worst mirror normal, against the ground truth",
    "normal_error_between_mirrors_max_deg": "worst mirror normal, without the rotation common to all mirrors",
    "distance_error_max_mm": "worst mirror distance, against the ground truth",
    "held_out_rms_x_px": "reprojection error of held-out frames, RMS in x",
    "held_out_rms_y_px": "reprojection error of held-out frames, RMS in y",
    "held_out_spatial_rms_mm": "distance of held-out corners from their viewing rays, RMS",
    "decoded_corner_rms_px": "corners in decoded views, against a pinhole at the true position, RMS",
}

LABELS: Mapping[str, str] = {**ASSEMBLY, **LIGHT, **MIRRORS, **PRINTED_PARTS, **DESIGNS, **VALIDATIONS}
