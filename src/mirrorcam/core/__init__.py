"""The base of all packages: checked values, files, pictures and video, processes, and the console."""
