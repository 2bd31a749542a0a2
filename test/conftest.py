# SPDX-License-Identifier: Apache-2.0
import os

# nothing that a test starts may be heard outside this machine
os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
