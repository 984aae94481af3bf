#!/usr/bin/env bash
# ROS and the environment of swardmap, then whatever the container is to run
set -e
source "/opt/ros/${ROS_DISTRO}/setup.bash"
export PATH="/opt/swardmap/bin:${PATH}"
exec "$@"
