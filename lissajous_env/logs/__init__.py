"""Logs of robots: written and read as rosbag2 files (MCAP), scored like episodes, and fitted by models of robots."""
