"""The filters of car policies: `-safe`, which avoids collisions, and `-proved`, which proves that there are none."""
