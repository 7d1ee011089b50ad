'use strict';
/* The page around web.c: what the wasm module imports, the picture, input, and what is done while nothing moves. */

const element = id => document.getElementById(id);
const QUALITIES = ['', 'draft', 'medium', 'high', 'ultra'];
const STILL_AFTER = 250;                       /* ms without input before the picture at rest is begun */
const PATHS = 8, PASSES = 40, CURVE_AFTER = 4; /* per pixel and pass; passes; passes before the curve is measured */

/* ------------------------------------------------------------------------------------------ what web.c imports */

/* Of WASI, only what reading one file takes. Numbers are its error codes. */
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

/* Where the browser tells of waiting input, long calls end for it. */
const page = {pending: () => measuring && navigator.scheduling?.isInputPending?.() ? 1 : 0};
let measuring = false, compiled;

async function start() {
    compiled ??= await WebAssembly.compile(Uint8Array.from(atob(element('wasm').text), c => c.charCodeAt(0)));
    wasm = (await WebAssembly.instantiate(compiled, {wasi_snapshot_preview1: wasi, page})).exports;
    opened.clear();
    wasm._initialize();
}

/* --------------------------------------------------------------------------------------------------- the picture */

const canvas = element('picture'), ink = canvas.getContext('2d'), small = document.createElement('canvas');
let moved = true, changed = 0, rest = 0; /* rest: steps done since the last change */
let curve = [], failed = false;

const say = sentence => { element('sentence').textContent = sentence; };
const percent = value => `${(100 * value).toPrecision(2)} %`;

/* Calls a function of web.c that returns 0 on success. Where the module has no memory left, it begins anew. */
async function call(name, ...values) {
    try {
        if (!wasm[name](...values)) return true;
        const sentence = text(wasm.web_sentence());
        if (!/cancelled/.test(sentence)) say(sentence), failed = true;
        return false;
    } catch (error) {
        say(lastWords || 'The module stopped, probably for lack of memory. It has begun anew.');
        lastWords = '';
        await start();
        if (element('scene').selectedIndex < 0) element('scene').selectedIndex = 0;
        wasm.web_choose(+element('scene').value);
        change();
        return false;
    }
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
    element('time').textContent = `${report.ms.toFixed(1)} ms` +
        (milliseconds ? `, ${(1000 / report.ms).toFixed(0)} frames a second` : ', at rest');
    element('pixels').textContent = `${report.width} × ${report.height}, ${(report.bytes / 1e6).toFixed(0)} MB`;
    element('setting').textContent = `${QUALITIES[report.quality]}, ${report.slabs} slabs` +
        (report.cells ? `, ${report.cells} cells of light made` : ', cells of light kept or not needed');
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

function showError() {
    const error = wasm.web_error(0, 0), noise = wasm.web_error(0, 1);
    element('error').textContent = error > noise ? `${percent(error)} of the mean (noise of the paths ${percent(noise)})`
                                                 : `below the paths' noise, ${percent(noise)} so far`;
}

/* Both axes are logarithmic. */
function showCurve() {
    const x = ms => 42 + 235 * Math.log(ms / 10) / Math.log(1000), y = e => 160 - 140 * Math.log(e / 1e-3) / Math.log(1e3);
    let drawn = '';
    for (const ms of [10, 100, 1000, 10000])
        drawn += `<line x1="${x(ms)}" x2="${x(ms)}" y1="20" y2="160"/><text x="${x(ms) - 12}" y="175">${ms} ms</text>`;
    for (const e of [0.001, 0.01, 0.1, 1])
        drawn += `<line x1="42" x2="277" y1="${y(e)}" y2="${y(e)}"/><text x="4" y="${y(e) + 4}">${100 * e} %</text>`;
    for (const {quality, ms, error} of curve) {
        const at = [x(Math.min(Math.max(ms, 10), 10000)), y(Math.min(Math.max(error, 1e-3), 1))];
        drawn += `<circle cx="${at[0]}" cy="${at[1]}" r="4"/><text x="${at[0] + 6}" y="${at[1] - 5}">` +
            `${QUALITIES[quality]}: ${ms.toFixed(0)} ms, ${percent(error)}</text>`;
    }
    element('curve').innerHTML = drawn;
}

/* Step 0: the picture at rest and the plan; then passes of paths, amid which the curve is measured. A step that input
   cancels is done again. */
async function restStep() {
    if (rest === 0) {
        if (!await frame(0)) return false;
        if (await call('web_plan', +element('quality').value)) showPlan();
        return true;
    }
    const trial = rest - CURVE_AFTER - 1;
    if (trial >= 0 && trial < 3) {
        const ms = wasm.web_try(trial + 1);
        if (ms < 0) { /* cancelled: again; else no more */
            failed = !/cancelled/.test(text(wasm.web_sentence()));
            return false;
        }
        /* noise below which nothing is known */
        curve.push({quality: trial + 1, ms, error: Math.max(wasm.web_error(1, 0), 0.3 * wasm.web_error(1, 1))});
        showCurve();
        return true;
    }
    if (!await call('web_measure', PATHS)) return false;
    showError();
    return true;
}

async function tick() {
    try {
        if (moved) {
            moved = false;
            await frame(+element('budget').value);
        } else if (!failed && rest < PASSES && performance.now() - changed > STILL_AFTER) {
            measuring = true;
            if (await restStep()) ++rest;
        }
    } finally {
        measuring = false;
        requestAnimationFrame(tick);
    }
}

/* ---------------------------------------------------------------------------------------------------------- input */

function change() {
    moved = true, failed = false, changed = performance.now(), rest = 0, curve = [];
    showCurve();
}

async function choose() {
    say('');
    if (await call('web_choose', +element('scene').value)) change();
}

async function open(file) {
    say(`Reading ${file.name} …`);
    const name = file.name.replace(/[/\\\0]/g, '_').slice(-120);
    const before = files.get(name);
    files.set(name, new Uint8Array(await file.arrayBuffer()));
    const encoded = new TextEncoder().encode(name);
    bytes().set(encoded.slice(0, 255), wasm.web_name());
    bytes()[wasm.web_name() + Math.min(encoded.length, 255)] = 0;
    if (!await call('web_open', wasm.web_name())) { /* the scene stays */
        if (before) files.set(name, before); else files.delete(name);
        failed = false;
        return;
    }
    for (const other of files.keys()) if (other !== name) files.delete(other);
    element('scene').selectedIndex = -1;
    say('');
    change();
}

function turn(x, y, light) {
    const speed = 0.008;
    if (light) wasm.web_turn_light(speed * x, -speed * y);
    else wasm.web_turn(-speed * x, speed * y);
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
    wasm.web_zoom(Math.max(apart(last), 1) / Math.max(apart(event), 1));
    turn(x / 2, y / 2, true);
});
for (const end of ['pointerup', 'pointercancel'])
    canvas.addEventListener(end, event => fingers.delete(event.pointerId));
canvas.addEventListener('contextmenu', event => event.preventDefault());
canvas.addEventListener('wheel', event => {
    event.preventDefault();
    wasm.web_zoom(Math.exp(0.001 * event.deltaY));
    change();
}, {passive: false});
canvas.addEventListener('keydown', event => {
    const arrow = {ArrowLeft: [-12, 0], ArrowRight: [12, 0], ArrowUp: [0, -12], ArrowDown: [0, 12]}[event.key];
    const nearer = {'+': 0.9, '=': 0.9, '-': 1.1, '−': 1.1}[event.key];
    if (!arrow && !nearer) return;
    event.preventDefault();
    if (arrow) return turn(...arrow, event.shiftKey);
    wasm.web_zoom(nearer);
    change();
});

element('scene').addEventListener('change', choose);
element('quality').addEventListener('change', change);
element('budget').addEventListener('input', () => {
    element('budget_text').textContent = `${element('budget').value} ms a frame`;
    change();
});
element('size').addEventListener('change', () => {
    canvas.width = +element('size').value, canvas.height = canvas.width * 3 / 4;
    change();
});
element('file').addEventListener('change', event => event.target.files[0] && open(event.target.files[0]));
document.addEventListener('dragover', event => { event.preventDefault(), canvas.classList.add('over'); });
document.addEventListener('dragleave', () => canvas.classList.remove('over'));
document.addEventListener('drop', event => {
    event.preventDefault();
    canvas.classList.remove('over');
    if (event.dataTransfer.files[0]) open(event.dataTransfer.files[0]);
});

/* An error while anything is done is said once, and the loop goes on. */
window.addEventListener('unhandledrejection', event => say(String(event.reason)));
element('budget_text').textContent = `${element('budget').value} ms a frame`;
start().then(choose).then(() => requestAnimationFrame(tick));
