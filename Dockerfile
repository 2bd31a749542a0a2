# SPDX-License-Identifier: Apache-2.0
# Nodes and programs on ROS 2 Jazzy:
#   docker build -t kalman_ros .
#   docker run --rm --net host kalman_ros ros2 run kalman_ros estimator --help
FROM ros:jazzy-ros-base

SHELL ["/bin/bash", "-o", "pipefail", "-c"]
WORKDIR /ws
# dependencies first: they are installed again only if package.xml changes
COPY package.xml src/kalman_ros/package.xml
RUN apt-get update \
    && rosdep update --rosdistro jazzy \
    && rosdep install -y --rosdistro jazzy --from-paths src --ignore-src \
    && rm -rf /var/lib/apt/lists/*
COPY . src/kalman_ros
RUN source /opt/ros/jazzy/setup.bash && colcon build --packages-select kalman_ros

ENTRYPOINT ["/bin/bash", "-c", "source /ws/install/setup.bash && exec \"$0\" \"$@\""]
CMD ["bash"]
