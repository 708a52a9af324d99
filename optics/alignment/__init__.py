"""How the mirrors of a device are turned from their design, measured by pictures of any scene, without a board."""
