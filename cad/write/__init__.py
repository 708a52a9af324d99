"""Files of parts and of the device for CAD programs, slicers, browsers and robots."""
