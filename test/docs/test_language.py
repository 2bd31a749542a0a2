# SPDX-License-Identifier: Apache-2.0
"""Text for people is plain engineering English: no file holds the phrases listed here."""

import ast
import io
import re
import tokenize
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]

#: A phrase to avoid, and what to write instead.
PHRASES = {
    r'\banew\b': 'again, restart',
    r'\bso (many|long|often)\b': 'a number, a duration, a rate',
    r'\bas often as\b': 'the number of times',
    r'\b(what|which|that) (has |have |had )?(come|came)\b': 'received, arrived',
    r'\b(has|have|had) come\b|\bmore came\b': 'is received, arrived',
    r'\b(hear|hears|heard)\b|\blistens? to\b': 'receive, subscribe',
    r'\btold\b': 'configured with, given',
    r'\bsays? (of|by|so)\b|\bsaid\b|\bwhat (\w+ )?(says|tells)\b': 'reports, contains',
    r'\btells? (of|what|which|whether)\b': 'shows, determines, returns whether',
    r'\blets? go\b': 'commands zero, starts',
    r'\bquiet\b': 'publishes nothing; small noise',
    r'\bbears? (little|no|more|any|it|rounding)\b': 'tolerates, has small margins',
    r'\breckon': 'is finite, assume',
    r'\bwhoever\b|\b(those )?who listen': 'a node, subscribers',
    r'\bwhose turn\b|\bof what\b|\bwhat there (is|was)\b': 'the noun itself',
    r'\bwhich never\b|\bthere since\b': 'since',
    r'\b(of|with) (its|their|one\'?s) own\b': 'private',
    r'\bby (itself|themselves)\b': 'alone, automatically',
    r'(?<!there )(?-i:\bis none\b)(?! of)': 'is not one',
    r'\b(is|are|was|were) to be\b': 'must be, will be',
    r'\bbrinks?\b': 'stability boundary',
    r'\bcontests?\b|\bcontestants?\b': 'benchmark',
    r'\badvice\b': 'warning, hint',
    r'\bgather(s|ed|ing)?\b': 'record, collect',
    r'\bbut for\b': 'except',
    r'\b(takes?|took) note\b|\bat (its|their) word\b': 'records, taken as exact',
    r'\bone (wants|likes)\b|\bto speak of\b': 'requested, negligible',
    r'\bgood enough\b': 'acceptable',
}

#: Words that are no part of a name either.
NAMES = {'anew', 'hear', 'hears', 'heard', 'told', 'said', 'brink', 'brinks', 'gather', 'quiet'}

#: A use that is right, by file and text: the reason.
ALLOWED = {
    ('kalman_ros/models/diff_drive.py', 'dead reckoning'): 'the term of navigation',
    ('docs/reference/scenarios.md', 'dead reckoning'): 'the term of navigation',
}

ANY = re.compile('|'.join(f'(?:{phrase})' for phrase in PHRASES), re.IGNORECASE)


def words(text):
    return ' '.join(text.split())


def python_texts(source):
    """Yield line and text of the strings of a module, and of its blocks of comments."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and ' ' in node.value:
            yield node.lineno, words(node.value)
    block, start, last = [], 0, -1
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type == tokenize.COMMENT:
            line = token.start[0]
            if line != last + 1:
                yield start, words(' '.join(block))
                block, start = [], line
            block.append(token.string.lstrip('#:'))
            last = line
    yield start, words(' '.join(block))


def page_texts(source):
    """Yield line and text of the paragraphs of a page, a YAML file's comments included."""
    line = 1
    for paragraph in source.split('\n\n'):
        yield line, words(re.sub(r'^\s*#', '', paragraph, flags=re.MULTILINE))
        line += paragraph.count('\n') + 2


def files():
    folders = [ROOT / name for name in ('kalman_ros', 'docs', 'config')]
    kinds = ('.py', '.md', '.yaml', '.xml')
    found = [p for folder in folders for p in sorted(folder.rglob('*')) if p.suffix in kinds]
    return [*found, ROOT / 'README.md', ROOT / 'CONTRIBUTING.md', ROOT / 'dev']


def findings(path):
    """Return the phrases in a file, each as (file, line, excerpt, what to write instead)."""
    source = path.read_text()
    texts = python_texts(source) if path.suffix == '.py' else page_texts(source)
    return [
        (
            str(path.relative_to(ROOT)),
            line,
            text[max(found.start() - 20, 0) : found.end() + 20],
            next(to for phrase, to in PHRASES.items() if re.match(phrase, found[0], re.I)),
        )
        for line, text in texts
        for found in ANY.finditer(text)
    ]


def allowed(finding):
    return any(finding[0] == name and text in finding[2] for name, text in ALLOWED)


@pytest.fixture(scope='module')
def found():
    return [finding for path in files() for finding in findings(path)]


@pytest.mark.slow
def test_no_file_holds_a_phrase_to_avoid(found):
    wrong = [
        f'{n}:{at}: "{text}": {to}' for n, at, text, to in found if not allowed((n, at, text))
    ]
    assert not wrong, '\n'.join(wrong)


@pytest.mark.slow
def test_every_allowed_use_is_still_there(found):
    gone = [
        (name, text)
        for name, text in ALLOWED
        if not any(name == each[0] and text in each[2] for each in found)
    ]
    assert not gone


def test_no_name_has_such_a_word():
    wrong = {
        f'{path.relative_to(ROOT)}: {name}'
        for path in (ROOT / 'kalman_ros').rglob('*.py')
        for name in re.findall(r'[A-Za-z_]\w*', path.read_text())
        if '_' in name and NAMES & set(name.strip('_').lower().split('_'))
    }
    assert not wrong, '\n'.join(sorted(wrong))


#: Patterns of text that says little, with how often each may occur: these numbers only fall.
PATTERNS = {r'Of ': 0, r'That of ': 0, r'Whether the \w+ is\.$': 0}
#: Names of variables that say nothing of what they hold, and in how many places they are left:
#: attributes of public classes.
EMPTY, MOST_EMPTY = {'found', 'each', 'own'}, 5


def modules():
    for path in sorted((ROOT / 'kalman_ros').rglob('*.py')):
        yield str(path.relative_to(ROOT)), ast.parse(path.read_text())


def test_docstrings_begin_with_what_they_describe():
    kinds = (ast.Module, ast.ClassDef, ast.FunctionDef)
    counts = dict.fromkeys(PATTERNS, 0)
    for _, tree in modules():
        for node in ast.walk(tree):
            text = (isinstance(node, kinds) and ast.get_docstring(node)) or ''
            for pattern in PATTERNS:
                counts[pattern] += bool(re.match(pattern, text.partition('\n')[0]))
    assert counts == PATTERNS


def test_variables_have_names_that_say_what_they_hold():
    places = [
        f'{path}:{node.lineno}'
        for path, tree in modules()
        for node in ast.walk(tree)
        if (isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store) and node.id in EMPTY)
        or (isinstance(node, ast.arg) and node.arg in EMPTY)
    ]
    assert len(places) == MOST_EMPTY, places


def test_strings_comments_and_line_breaks_are_searched():
    source = '"""What is\ntold."""\n# so\n# many\nX = f"{1} is quiet"\n'
    found = [each[0] for _, text in python_texts(source) for each in [ANY.search(text)] if each]
    assert sorted(found) == ['quiet', 'so many', 'told']
