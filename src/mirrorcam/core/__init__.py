"""What every package stands on: checked values, files, pictures and video, processes, and the console."""
