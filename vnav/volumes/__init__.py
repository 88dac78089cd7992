"""Octree, TSDF, clouds and ray casting: the only users of octomap and open3d."""
