# SPDX-License-Identifier: Apache-2.0
"""The filters, one per file: the name of the file is the name, and ``FILTER`` is the class.

A new filter needs only a new file: parameters, help, nodes, replays, studies and tests list these
files and read the attributes of the class.
"""
