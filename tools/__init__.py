"""What builds and tests the Blender add-on; run from the project's folder with -m."""
