'use strict';
/* The page around web.c: what the wasm module imports, the picture, input, and what is done while nothing moves. */

const element = id => document.getElementById(id);
const QUALITIES = ['', 'draft', 'medium', 'high', 'ultra'];
const STILL_AFTER = 250;                       /* ms without input before the picture at rest is begun */
const PASSES = 40, CURVE_AFTER = 4;          /* passes of paths; those before other qualities are tried */
const PATIENCE = 1500, TRIAL_PATIENCE = 5000;  /* ms that a pass of paths, and a trial, may take */

/* ------------------------------------------------------------------------------------------ what web.c imports */

/* The part of WASI that reading one file needs. The numbers are its error codes. */
const OK = 0, BAD_FILE = 8, NO_ENTRY = 44, FOLDER = 3, FIRST_FILE = 4;
const files = new Map(); /* name: bytes */
const opened = new Map(); /* descriptor: {bytes, at} */
let wasm, descriptor = FIRST_FILE;

const bytes = () => new Uint8Array(wasm.memory.buffer);
const data = () => new DataView(wasm.memory.buffer);
const textAt = (at, length) => new TextDecoder().decode(bytes().slice(at, at + length));
const text = at => textAt(at, bytes().indexOf(0, at) - at);

function readInto(file, vectors, count, at, read) {
    let total = 0;
    for (let i = 0; i < count; ++i) {
        const to = data().getUint32(vectors + 8 * i, true), most = data().getUint32(vectors + 8 * i + 4, true);
        const part = file.bytes.subarray(at + total, at + total + most);
        bytes().set(part, to);
        total += part.length;
    }
    data().setUint32(read, total, true);
    return total;
}

function writeFileStat(at, size) {
    bytes().fill(0, at, at + 64);
    data().setUint8(at + 16, 4); /* a regular file */
    data().setBigUint64(at + 32, BigInt(size), true);
    return OK;
}

const wasi = {
    clock_time_get(id, precision, at) {
        data().setBigUint64(at, BigInt(Math.round(1e6 * performance.now())), true);
        return OK;
    },
    fd_prestat_get(fd, at) {
        if (fd !== FOLDER) return BAD_FILE;
        data().setUint32(at, 0, true), data().setUint32(at + 4, 1, true);
        return OK;
    },
    fd_prestat_dir_name(fd, at) {
        bytes()[at] = '.'.charCodeAt(0);
        return OK;
    },
    fd_fdstat_get(fd, at) {
        if (fd > FOLDER && !opened.has(fd)) return BAD_FILE;
        bytes().fill(0, at, at + 24);
        data().setUint8(at, fd < FOLDER ? 2 : fd === FOLDER ? 3 : 4);
        data().setBigUint64(at + 8, 0x1fffffffn, true), data().setBigUint64(at + 16, 0x1fffffffn, true);
        return OK;
    },
    fd_fdstat_set_flags: () => OK,
    fd_filestat_get: (fd, at) => opened.has(fd) ? writeFileStat(at, opened.get(fd).bytes.length) : BAD_FILE,
    path_filestat_get(fd, flags, path, length, at) {
        const file = files.get(textAt(path, length));
        return file ? writeFileStat(at, file.length) : NO_ENTRY;
    },
    path_open(folder, look, path, length, how, rights, inherited, flags, fd) {
        const file = files.get(textAt(path, length));
        if (!file) return NO_ENTRY;
        opened.set(descriptor, {bytes: file, at: 0});
        data().setUint32(fd, descriptor++, true);
        return OK;
    },
    fd_read(fd, vectors, count, read) {
        const file = opened.get(fd);
        if (!file) return BAD_FILE;
        file.at += readInto(file, vectors, count, file.at, read);
        return OK;
    },
    fd_pread(fd, vectors, count, at, read) {
        if (!opened.has(fd)) return BAD_FILE;
        readInto(opened.get(fd), vectors, count, Number(at), read);
        return OK;
    },
    fd_seek(fd, offset, from, at) {
        const file = opened.get(fd);
        if (!file) return BAD_FILE;
        file.at = Number(offset) + (from === 0 ? 0 : from === 1 ? file.at : file.bytes.length);
        data().setBigUint64(at, BigInt(file.at), true);
        return OK;
    },
    fd_close: fd => opened.delete(fd) ? OK : BAD_FILE,
    fd_write(fd, vectors, count, written) { /* what the readers say before they exit */
        let said = '';
        for (let i = 0; i < count; ++i)
            said += textAt(data().getUint32(vectors + 8 * i, true), data().getUint32(vectors + 8 * i + 4, true));
        data().setUint32(written, said.length, true);
        lastWords = said.trim() || lastWords;
        return OK;
    },
    proc_exit(status) { throw new Error(`exit ${status}`); },
};
let lastWords = '';

/* While nothing moves, calls end at a deadline and, where the browser tells of it, for waiting input. */
const page = {pending: () => measuring && (performance.now() > deadline ||
    navigator.scheduling?.isInputPending?.({includeContinuous: steps > 0})) ? 1 : 0};
let measuring = false, deadline = Infinity, compiled;

async function start() {
    compiled ??= await WebAssembly.compile(Uint8Array.from(atob(element('wasm').text), c => c.charCodeAt(0)));
    wasm = (await WebAssembly.instantiate(compiled, {wasi_snapshot_preview1: wasi, page})).exports;
    opened.clear();
    wasm._initialize();
}

/* --------------------------------------------------------------------------------------------------- the picture */

const canvas = element('picture'), ink = canvas.getContext('2d'), small = document.createElement('canvas');
let moved = true, changed = 0, steps = 0; /* steps: done since the last change */
let curve = [], stopped = false, paths = 8, restarts = 0, lastEnd = 0, request = 0;
let alias = '', shownName = ''; /* a dropped file's name in the module, and its own */

const say = sentence => {
    element('sentence').textContent = alias ? sentence.replaceAll(alias, shownName) : sentence;
};
const percent = value => `${value >= 1 ? (100 * value).toFixed(0) : value < 1e-5 ? '< 0.001' : (100 * value).toPrecision(2)} %`;
const wasCancelled = () => /^cancelled by/.test(text(wasm.web_sentence()));

/* Calls a function of web.c that returns 0 on success. A module that ends, usually for lack of memory, is restarted,
   but not for ever. */
async function call(name, ...values) {
    try {
        if (!wasm[name](...values)) return true;
        if (!wasCancelled()) say(text(wasm.web_sentence())), stopped = true;
    } catch (error) {
        await start();
        const again = ++restarts < 3;
        if (element('scene').value === 'file') element('scene').value = '0';
        say(`${lastWords || 'The module ended, probably for lack of memory'}; it was restarted${again ? '' : ' for the last time'}.`);
        lastWords = '';
        if (again && !wasm.web_choose(+element('scene').value)) restart();
        else stopped = true;
    }
    return false;
}

function draw(report) {
    const codes = new Uint8ClampedArray(wasm.memory.buffer, wasm.web_codes(), 4 * report.width * report.height);
    const image = new ImageData(codes.slice(), report.width, report.height);
    if (report.width === canvas.width) return ink.putImageData(image, 0, 0);
    small.width = report.width, small.height = report.height;
    small.getContext('2d').putImageData(image, 0, 0);
    ink.drawImage(small, 0, 0, canvas.width, canvas.height);
}

async function frame(milliseconds) {
    const quality = +element('quality').value;
    if (!await call('web_frame', canvas.width, canvas.height, milliseconds, quality)) return false;
    const report = JSON.parse(text(wasm.web_report()));
    draw(report);
    const between = performance.now() - lastEnd;
    lastEnd = performance.now();
    const rate = between < STILL_AFTER ? `, ${(1000 / between).toFixed(0)} frames a second` : '';
    element('time').textContent = `${report.ms.toFixed(0)} ms${milliseconds ? rate : ', at rest'}`;
    element('pixels').textContent = `${report.width} × ${report.height}`;
    element('setting').textContent = `${QUALITIES[report.quality]}, ${report.slabs} slabs` +
        (report.cells ? `, ${report.cells} cells of light made` : ', no cells of light made');
    element('memory').textContent = `${(wasm.memory.buffer.byteLength / 1e6).toFixed(0)} MB`;
    element('error').textContent = milliseconds ? 'measured at rest' : '…';
    return true;
}

/* ------------------------------------------------------------------------------------------- while nothing moves */

function showPlan() {
    const rows = JSON.parse(text(wasm.web_report()));
    element('plan').replaceChildren(...rows.map(([name, runs, reason]) => {
        const row = document.createElement('tr');
        for (const cell of [runs ? `${name} × ${runs}` : name, reason]) row.insertCell().textContent = cell;
        row.style.opacity = runs ? 1 : 0.6;
        return row;
    }));
}

/* The error of a picture, or what it is less than. */
function difference(quality) {
    const error = wasm.web_difference(quality, 0), noise = wasm.web_difference(quality, 1);
    return error > noise ? {value: error, text: percent(error), known: true}
                         : {value: noise, text: `< ${percent(noise)}`, known: false};
}

function showError() {
    const {text: shown, known} = difference(0);
    element('error').textContent = `${shown} of the mean` +
        (known ? `, noise ${percent(wasm.web_difference(0, 1))}` : ", the reference's noise so far");
}

/* Both axes are logarithmic. Hollow: the error is less than that. */
function showCurve() {
    const x = ms => 42 + 235 * Math.log(ms / 10) / Math.log(1000), y = e => 160 - 140 * Math.log(e / 1e-3) / Math.log(1e3);
    let drawn = '', rows = '';
    for (const ms of [10, 100, 1000, 10000])
        drawn += `<line x1="${x(ms)}" x2="${x(ms)}" y1="20" y2="160"/><text x="${x(ms) - 12}" y="175">${ms} ms</text>`;
    for (const e of [0.001, 0.01, 0.1, 1])
        drawn += `<line x1="42" x2="277" y1="${y(e)}" y2="${y(e)}"/><text x="4" y="${y(e) + 4}">${100 * e} %</text>`;
    for (const {quality, ms} of curve) {
        const error = difference(quality), up = quality % 2 ? -7 : 15;
        const at = [x(Math.min(Math.max(ms, 10), 10000)), y(Math.min(Math.max(error.value, 1e-3), 1))];
        drawn += `<circle cx="${at[0]}" cy="${at[1]}" r="4"${error.known ? '' : ' class="less"'}/>` +
            `<text x="${at[0]}" y="${at[1] + up}" text-anchor="middle">${QUALITIES[quality]}</text>`;
        rows += `<tr><td>${QUALITIES[quality]}<td>${ms.toFixed(0)} ms<td>${error.text}`;
    }
    element('curve').innerHTML = drawn;
    element('curve_rows').innerHTML = rows;
}

/* Adds a pass of paths, with fewer where they take too long. */
async function measure() {
    deadline = performance.now() + PATIENCE;
    const began = performance.now(), done = await call('web_measure', paths);
    if (!done && !stopped && performance.now() - began >= PATIENCE) {
        if (paths > 2) paths /= 2;
        else steps = PASSES, element('error').textContent = 'too costly to measure here';
    }
    if (done) showError(), showCurve();
    return done;
}

/* Tries a quality that is not shown; one that fails or takes too long is left out. */
async function tryQuality(quality) {
    const began = performance.now();
    deadline = began + TRIAL_PATIENCE;
    const done = await call('web_try', quality);
    if (done) curve.push({quality, ms: +text(wasm.web_report())}), showCurve();
    return done || performance.now() - began >= TRIAL_PATIENCE;
}

/* Step 0: the picture at rest and the plan; then passes of paths, amid which other qualities are tried. A step that
   input cancels is done again. */
async function step() {
    if (steps === 0) {
        deadline = Infinity;
        if (!await frame(0)) return false;
        if (await call('web_plan', +element('quality').value)) showPlan();
        restarts = 0;
        return true;
    }
    const trial = steps - CURVE_AFTER;
    return trial > 0 && trial < QUALITIES.length ? tryQuality(trial) : measure();
}

async function tick() {
    try {
        if (moved) {
            moved = false;
            await frame(+element('budget').value);
        } else if (!stopped && steps < PASSES && performance.now() - changed > STILL_AFTER) {
            measuring = true;
            if (await step()) ++steps;
        }
    } finally {
        measuring = false;
        requestAnimationFrame(tick);
    }
}

/* ---------------------------------------------------------------------------------------------------------- input */

function restart() {
    moved = true, stopped = false, changed = performance.now(), steps = 0, curve = [], paths = 8;
    showCurve();
}

function change() {
    restarts = 0;
    restart();
}

async function choose() {
    const mine = ++request;
    say('');
    if (await call('web_choose', +element('scene').value) && mine === request) change();
}

/* The module sees a short name with the file's ending; sentences have the file's own. The last request wins. */
async function open(file) {
    const mine = ++request;
    if (!wasm) return;
    if (file.size > 4e8) return say(`${file.name}: ${(file.size / 1e6).toFixed(0)} MB are too many for the page`);
    say(`Reading ${file.name} …`);
    const content = await file.arrayBuffer().catch(() => null);
    if (mine !== request) return;
    if (!content) return say(`${file.name}: the browser cannot read it`);
    const ending = file.name.match(/(\.nii)?\.[a-z0-9]{1,8}$/i)?.[0].toLowerCase() ?? '';
    const before = [alias, shownName], wasStopped = stopped;
    alias = `file${mine}${ending}`, shownName = file.name;
    files.set(alias, new Uint8Array(content));
    bytes().set(new TextEncoder().encode(`${alias}\0`), wasm.web_name());
    const opens = await call('web_open', wasm.web_name());
    if (!opens) {
        files.delete(alias);
        [alias, shownName] = before, stopped = wasStopped; /* the scene stays */
        return;
    }
    for (const other of files.keys()) if (other !== alias) files.delete(other);
    element('dropped').hidden = false, element('dropped').textContent = file.name;
    element('scene').value = 'file';
    say('');
    change();
}

function turn(x, y, light) {
    const speed = 0.008;
    if (!wasm) return;
    if (light) wasm.web_turn_light(speed * x, -speed * y);
    else wasm.web_turn(-speed * x, speed * y);
    change();
}

function zoom(factor) {
    if (!wasm) return;
    wasm.web_zoom(factor);
    change();
}

const fingers = new Map();
let lights = false;
canvas.addEventListener('pointerdown', event => {
    canvas.setPointerCapture(event.pointerId);
    canvas.focus({preventScroll: true});
    fingers.set(event.pointerId, event);
    lights = event.button === 2 || event.shiftKey || event.altKey || event.ctrlKey;
});
canvas.addEventListener('pointermove', event => {
    const last = fingers.get(event.pointerId);
    if (!last) return;
    const x = event.clientX - last.clientX, y = event.clientY - last.clientY;
    const other = [...fingers.values()].find(finger => finger.pointerId !== event.pointerId);
    fingers.set(event.pointerId, event);
    if (!other) return turn(x, y, lights);
    const apart = finger => Math.hypot(finger.clientX - other.clientX, finger.clientY - other.clientY);
    zoom(Math.max(apart(last), 1) / Math.max(apart(event), 1));
    turn(x / 2, y / 2, true);
});
for (const end of ['pointerup', 'pointercancel'])
    canvas.addEventListener(end, event => fingers.delete(event.pointerId));
canvas.addEventListener('contextmenu', event => event.preventDefault());
canvas.addEventListener('wheel', event => {
    event.preventDefault();
    zoom(Math.exp(0.001 * event.deltaY));
}, {passive: false});
canvas.addEventListener('keydown', event => {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const arrow = {ArrowLeft: [-12, 0], ArrowRight: [12, 0], ArrowUp: [0, -12], ArrowDown: [0, 12]}[event.key];
    const nearer = {'+': 0.9, '=': 0.9, '-': 1.1, '−': 1.1}[event.key];
    if (!arrow && !nearer) return;
    event.preventDefault();
    if (arrow) return turn(...arrow, event.shiftKey);
    zoom(nearer);
});

element('scene').addEventListener('change', () => element('scene').value !== 'file' && choose());
element('quality').addEventListener('change', change);
element('budget').addEventListener('input', () => {
    element('budget_text').textContent = `${element('budget').value} ms`;
    change();
});
element('size').addEventListener('change', () => {
    canvas.width = +element('size').value, canvas.height = canvas.width * 3 / 4;
    change();
});
element('file').addEventListener('change', event => {
    if (event.target.files[0]) open(event.target.files[0]);
    event.target.value = '';
});
document.addEventListener('dragover', event => { event.preventDefault(), canvas.classList.add('over'); });
document.addEventListener('dragleave', () => canvas.classList.remove('over'));
document.addEventListener('drop', event => {
    event.preventDefault();
    canvas.classList.remove('over');
    if (event.dataTransfer.files[0]) open(event.dataTransfer.files[0]);
});

/* An error while anything is done is said once, and the loop goes on. */
window.addEventListener('unhandledrejection', event => {
    event.preventDefault();
    say(String(event.reason));
});
element('budget_text').textContent = `${element('budget').value} ms`;
start().then(choose).then(() => requestAnimationFrame(tick));
